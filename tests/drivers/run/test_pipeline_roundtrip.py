"""Any value of any configuration key survives the command line and the report's JSON."""

from __future__ import annotations

import json
import types
import typing
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from evs.drivers import settings
from evs.drivers.run.config import PipelineConfig
from evs.emulator.config import RunConfig
from evs.msgs import EvsError

pytestmark = pytest.mark.property


def plain_keys(cls: type, prefix: str = "") -> list[tuple[str, Any]]:
    """(dotted name, annotation) of every key that holds a value; arrays of tables by place 0."""
    found = []
    for name, annotation in typing.get_type_hints(cls).items():
        if isinstance(annotation, type) and hasattr(annotation, "__dataclass_fields__"):
            found += plain_keys(annotation, f"{prefix}{name}.")
        elif hasattr((*typing.get_args(annotation), None)[0], "__dataclass_fields__"):
            found += plain_keys(typing.get_args(annotation)[0], f"{prefix}{name}.0.")
        else:
            found.append((prefix + name, annotation))
    return found


def is_union(annotation: Any) -> bool:
    """`A | B`, also where a type variable stood for B."""
    return isinstance(annotation, types.UnionType) or typing.get_origin(annotation) is typing.Union


def values(annotation: Any) -> st.SearchStrategy[Any]:
    if is_union(annotation):
        return st.one_of([values(kind) for kind in typing.get_args(annotation)])
    if typing.get_origin(annotation) is tuple and Ellipsis in typing.get_args(annotation):
        return st.lists(values(typing.get_args(annotation)[0]), max_size=5).map(tuple)
    if typing.get_origin(annotation) is tuple:
        return st.tuples(*[values(kind) for kind in typing.get_args(annotation)])
    strategies: dict[Any, st.SearchStrategy[Any]] = {
        int: st.integers(-(2**63) + 1, 2**63 - 1),
        float: st.floats(allow_nan=False, allow_infinity=False),
        bool: st.booleans(),
        str: st.text(st.characters(exclude_categories=["Cs"])),
        type(None): st.none(),
    }
    return strategies[annotation]


KEYS = plain_keys(PipelineConfig)


def reach(config: Any, key: str) -> Any:
    for part in key.split("."):
        config = config[int(part)] if part.isdecimal() else getattr(config, part)
    return config


def attempt(key: str, text: str) -> tuple[PipelineConfig | None, str]:
    """The changed configuration, or what was said against it."""
    try:
        return settings.override(PipelineConfig(), key, text), ""
    except EvsError as error:
        return None, str(error)


def test_all_keys_of_the_emulator_are_there() -> None:
    names = [name for name, _ in KEYS]
    assert {name for name, _ in plain_keys(RunConfig)} < set(names)
    assert {"render.spp", "sensor.pos_thres", "sink.0.address", "pace"} < set(names)
    # places apart, these are the names that the nearest known key is looked for in
    assert {name.replace(".0.", ".N.") for name in names} <= set(settings.key_names(PipelineConfig))


@given(st.data())
def test_any_value_of_any_key_round_trips_through_text(data: st.DataObject) -> None:
    key, annotation = data.draw(st.sampled_from(KEYS))
    value = data.draw(values(annotation))
    config = settings.override(PipelineConfig(), key, settings.to_text(value))
    assert reach(config, key) == value
    assert type(reach(config, key)) is type(value)
    # through JSON, as reports and recordings carry it
    again = settings.build(PipelineConfig, json.loads(json.dumps(settings.to_plain(config))))
    assert again == config


@given(st.text(), st.text())
def test_any_two_words_give_a_configuration_or_one_line(key: str, text: str) -> None:
    config, said = attempt(key, text)
    assert isinstance(config, PipelineConfig) or said.startswith("at ")


@given(st.data())
def test_any_text_for_any_key_gives_a_value_of_its_type_or_one_line(data: st.DataObject) -> None:
    key, annotation = data.draw(st.sampled_from(KEYS))
    text = data.draw(st.one_of(st.text(), st.sampled_from(["nan", "[", "1,", "{a=1}", "1e999"])))
    config, said = attempt(key, text)
    if config is None:
        assert said.startswith(f"at {key}")
        assert "\n" not in said
    else:
        value = reach(config, key)
        kinds = typing.get_args(annotation) if is_union(annotation) else ()
        allowed = [typing.get_origin(kind) or kind for kind in kinds or (annotation,)]
        assert type(value) in allowed
