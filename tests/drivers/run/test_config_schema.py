"""The JSON Schema of pipelines: as strict as the loader, for what a schema can express."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import jsonschema
import pytest

import evs
from evs.drivers.run import config
from evs.drivers.run.config_reference import pipeline_schema
from evs.emulator.config import decoding
from evs.msgs import EvsError

PIPELINES = sorted(Path(evs.__file__).parent.glob("config/pipelines/*.toml"))


@pytest.fixture(scope="module")
def validator() -> jsonschema.Draft7Validator:
    return jsonschema.Draft7Validator(pipeline_schema())


def test_it_is_a_schema_with_every_key_and_its_meaning(
    validator: jsonschema.Draft7Validator,
) -> None:
    jsonschema.Draft7Validator.check_schema(validator.schema)
    for name in decoding.key_names(config.PipelineConfig):
        place: Any = validator.schema
        for part in name.split("."):
            place = place["items"] if part == "N" else place["properties"][part]
        assert place.get("description") or place["type"] in ("object", "array"), name


@pytest.mark.parametrize("path", PIPELINES, ids=lambda path: path.stem)
def test_every_pipeline_that_comes_with_evs_is_valid(
    validator: jsonschema.Draft7Validator, path: Path
) -> None:
    validator.validate(tomllib.loads(path.read_text()))


VALID = [
    "",
    "pace = 'realtime'\nworker = true",
    "[[sink]]\ntype = 'zmq'\naddress = 'tcp://127.0.0.1:5560'\nworker_mb = 2.5",
    "[sensor]\ncutoff_hz = 100\n[sensor.biases]\nbias_fo = 3",
    "[sensor]\npos_thres = 0.2\n[randomise]\nneg_thres = 'uniform(0.1, 0.3)'",
    "[scene]\nfile = 'a.xml'\ntick_us = 500\ncamera = 'eye'\n[camera]\nfovy = 40",
]
INVALID = [
    ("[render]\nsppp = 4", "sppp"),
    ("[render]\nspp = 'four'", "spp"),
    ("[render]\nspp = 1.5", "spp"),
    ("overwrite = 1", "overwrite"),
    ("[sensor]\ncutoff_hz = -1.0", "cutoff_hz"),
    ("[[sink]]\ntype = 'zqm'", "type"),
    ("[[sink]]\ntype = 'es'", "type"),
    ("[sink]\ntype = 'zmq'", "sink"),
    ("sensor = 3", "sensor"),
]


def loads(text: str) -> None:
    """As the loader reads it: into the classes, and its sensor."""
    found = config.load(tables=tomllib.loads(text))
    evs.emulator.sensor.presets.resolve_sensor(found.sensor)


@pytest.mark.parametrize("text", VALID)
def test_what_is_valid_is(validator: jsonschema.Draft7Validator, text: str) -> None:
    validator.validate(tomllib.loads(text))


@pytest.mark.parametrize(("text", "key"), INVALID)
def test_what_the_loader_refuses_is_an_error_at_its_key(
    validator: jsonschema.Draft7Validator, text: str, key: str
) -> None:
    tables = tomllib.loads(text)
    errors = list(validator.iter_errors(tables))
    assert len(errors) == 1
    assert key in f"{errors[0].json_path} {errors[0].message}"
    with pytest.raises(EvsError):
        loads(text)
