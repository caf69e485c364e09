"""A keyword that does not exist is answered with the nearest that do, as a TypeError."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable
from typing import Any

import pytest

import evs
from evs.drivers.gym import LoopEnv
from evs.msgs import EvsError


@pytest.mark.parametrize(
    ("make", "keyword", "nearest"),
    [
        (evs.SensorConfig, "pos_tres", "pos_thres"),
        (evs.BiasConfig, "bias_fp", "bias_fo"),
        (evs.ReadoutConfig, "ordr", "order"),
        (evs.ApsConfig, "enable", "enabled"),
        (evs.ImuConfig, "enable", "enabled"),
        (evs.CameraConfig, "fov", "fovy"),
        (evs.RenderConfig, "rendrer", "renderer"),
        (evs.SceneConfig, "tik_us", "tick_us"),
        (evs.ModelConfig, "nam", "name"),
        (evs.DelayConfig, "transport_u", "transport_us"),
        (lambda **k: LoopEnv("x.xml", **k), "sensr", "sensor"),
        (lambda **k: evs.make_vec("x.xml", 2, **k), "observaton", "observation"),
        (lambda **k: evs.make_vec("evs/CartPole-v0", 2, **k), "observaton", "observation"),
    ],
)
@pytest.mark.parametrize("kind", [EvsError, TypeError])
def test_the_nearest_comes_first(
    make: Callable[..., Any], keyword: str, nearest: str, kind: type[Exception]
) -> None:
    with pytest.raises(kind, match=f"has no keyword '{keyword}'; nearest: {nearest}"):
        make(**{keyword: 1})


def test_configurations_copy_as_before() -> None:
    one = evs.SensorConfig(pos_thres=0.3)
    assert copy.deepcopy(one) == pickle.loads(pickle.dumps(one)) == one
