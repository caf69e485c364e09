"""camera_info as ROS's calibration file, which camera_info_manager reads."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Sequence
from typing import Any

from evs.msgs import EvsError, StreamInfo

MATRICES = (
    ("camera_matrix", "k", 3, 3),
    ("distortion_coefficients", "d", 1, None),
    ("rectification_matrix", "r", 3, 3),
    ("projection_matrix", "p", 3, 4),
)
"""name in the file, field of CameraInfo, rows, columns; None: as many as there are"""


def calibration_yaml(stream: StreamInfo) -> str:
    """The text of a calibration file.

    Args:
        stream: A stream whose camera_info is set.

    Raises:
        EvsError: The camera_info is incomplete, or the camera is orthographic.
    """
    info = stream.camera_info
    if info.get("projection") == "orthographic":
        raise EvsError(
            f"camera '{stream.camera}' is orthographic, and ROS's calibration has no such camera: "
            "use a perspective one"
        )
    model = info.get("distortion_model")
    if not isinstance(model, str):
        raise _lacking("distortion_model")
    lines = [
        f"image_width: {_size(info, 'width')}",
        f"image_height: {_size(info, 'height')}",
        f"camera_name: {_word(stream.camera)}",
        f"distortion_model: {_word(model)}",
    ]
    for name, field, rows, columns in MATRICES:
        values: Any = info.get(field)
        if not _are_numbers(values) or (columns and len(values) != rows * columns):
            raise _lacking(field)
        data = ", ".join(map(_number, values))
        shape = [f"  rows: {rows}", f"  cols: {columns or len(values)}"]
        lines += [f"{name}:", *shape, f"  data: [{data}]"]
    return "\n".join(lines) + "\n"


def _size(info: dict[str, Any], field: str) -> int:
    value = info.get(field)
    if not isinstance(value, int) or isinstance(value, bool) or value < 1:
        raise _lacking(field)
    return value


def _are_numbers(values: Any) -> bool:
    return isinstance(values, Sequence) and all(
        isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
        for value in values
    )


def _number(value: float) -> str:
    """A float in YAML 1.1, where 1e-05 without a point would be a string."""
    text = repr(float(value))
    return text if "." in text or "e" not in text else text.replace("e", ".0e")


def _word(text: str) -> str:
    """Without quotes where that is safe, else as a JSON string, which is valid YAML."""
    return text if re.fullmatch(r"[A-Za-z_]\w*", text, re.ASCII) else json.dumps(text)


def _lacking(field: str) -> EvsError:
    return EvsError(
        f"the recording has no camera_info.{field}, so there is no calibration to write: record "
        "it again with this version of evs"
    )
