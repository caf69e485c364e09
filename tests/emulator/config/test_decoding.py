"""Decoding: TOML and dotted keys into dataclasses and back, and the path to every bad value."""

from __future__ import annotations

import json
import tomllib
import types
import typing
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from evs.drivers.run.config import PipelineConfig
from evs.drivers.run.config_reference import describe, field_docs
from evs.drivers.sink_config import SinkConfig
from evs.emulator.config import RunConfig, decoding
from evs.msgs import EvsError


@dataclass(frozen=True)
class Leaf:
    """[leaf]: a table."""

    count: int = 3
    """how many
    of them"""
    share: float = 0.5
    name: str = "x"
    flag: bool = False
    """whether"""
    maybe: int | None = None
    word: str | None = None
    point: tuple[float, float, float] | None = None


@dataclass(frozen=True)
class Root:
    """The root."""

    leaf: Leaf = field(default_factory=Leaf)
    item: tuple[Leaf, ...] = ()
    top: int = 1


@dataclass(frozen=True)
class Free:
    """A table whose keys are free."""

    ranges: Mapping[str, str] = field(default_factory=dict)
    top: int = 1


def message(call: object, *args: object) -> str:
    assert callable(call)
    with pytest.raises(EvsError) as caught:
        call(*args)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_tables_become_dataclasses_and_absent_keys_keep_their_defaults() -> None:
    text = (
        'top = 7\n[leaf]\nshare = 2\npoint = [1, 2, 3]\n[[item]]\nname = "a"\n[[item]]\ncount = 9\n'
    )
    root = decoding.build(Root, tomllib.loads(text))
    assert root == Root(
        leaf=Leaf(share=2.0, point=(1.0, 2.0, 3.0)), item=(Leaf(name="a"), Leaf(count=9)), top=7
    )
    # an integer in the file is a float in the class: 2 and 2.0 are one configuration
    assert type(root.leaf.share) is float


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[leaf]\ncuont = 4", "at leaf.cuont: unknown key; nearest known: leaf.count"),
        ("[laef]\ncount = 4", "at laef: unknown key; nearest known: leaf"),
        (
            "[[item]]\n[[item]]\nshaer = 1",
            "at item.1.shaer: unknown key; nearest known: item.1.share",
        ),
        ('[leaf]\ncount = "x"', 'at leaf.count: expected an integer, got "x"'),
        ("[leaf]\ncount = 1.5", "at leaf.count: expected an integer, got 1.5"),
        ("[leaf]\ncount = true", "at leaf.count: expected an integer, got true"),
        (
            "[leaf]\ncount = 9223372036854775808",
            "at leaf.count: expected an integer, got 9223372036854775808",
        ),
        ("[leaf]\nflag = 1", "at leaf.flag: expected true or false, got 1"),
        ("[leaf]\nname = 1", "at leaf.name: expected a string, got 1"),
        ("[leaf]\nshare = nan", "at leaf.share: expected a finite number, got nan"),
        ("[leaf]\nshare = -inf", "at leaf.share: expected a finite number, got -inf"),
        ('[leaf]\nmaybe = "a"', 'at leaf.maybe: expected an integer or none, got "a"'),
        ("[leaf]\npoint = [1, 2]", "at leaf.point: expected 3 numbers or none, got [1, 2]"),
        ('[leaf]\npoint = [1, "b", 2]', 'at leaf.point.1: expected a finite number, got "b"'),
        ("leaf = 3", "at leaf: expected a table, got 3"),
        ("item = 3", "at item: expected an array of tables [[item]], got a single value"),
        ("item = [3]", "at item.0: expected a table, got 3"),
        ("[leaf]\ncount = {a = 1}", "at leaf.count: expected an integer, got a table"),
    ],
)
def test_a_bad_value_is_told_with_its_path(text: str, said: str) -> None:
    assert message(decoding.build, Root, tomllib.loads(text)) == said


def test_malformed_toml_is_told_with_its_line(tmp_path: Path) -> None:
    file = tmp_path / "x.toml"
    file.write_text("a = 1\nb = = 2\n")
    said = message(decoding.read_toml, file)
    assert said.startswith(f"{file}: malformed TOML: ")
    assert "line 2" in said


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    assert message(decoding.read_toml, tmp_path / "no.toml") == f"no file '{tmp_path}/no.toml'"
    assert "cannot read" in message(decoding.read_toml, tmp_path)
    binary = tmp_path / "binary.toml"
    binary.write_bytes(b"\xff\xfe\x00")
    assert "not UTF-8" in message(decoding.read_toml, binary)


@pytest.mark.parametrize(
    ("key", "text", "expected"),
    [
        ("top", "0x10", Root(top=16)),
        ("leaf.count", "-4", Root(leaf=Leaf(count=-4))),
        ("leaf.share", "1e-3", Root(leaf=Leaf(share=1e-3))),
        ("leaf.share", ".5", Root(leaf=Leaf(share=0.5))),
        ("leaf.share", "5.", Root(leaf=Leaf(share=5.0))),
        ("leaf.name", "4", Root(leaf=Leaf(name="4"))),
        ("leaf.name", '"a b"', Root(leaf=Leaf(name="a b"))),
        ("leaf.name", "a=b#c", Root(leaf=Leaf(name="a=b#c"))),
        ("leaf.name", "", Root(leaf=Leaf(name=""))),
        ("leaf.name", "none", Root(leaf=Leaf(name="none"))),
        ("leaf.word", "none", Root()),
        ("leaf.word", '"none"', Root(leaf=Leaf(word="none"))),
        ("leaf.flag", "True", Root(leaf=Leaf(flag=True))),
        ("leaf.flag", "off", Root()),
        ("leaf.maybe", "None", Root()),
        ("leaf.point", "1,2,3", Root(leaf=Leaf(point=(1.0, 2.0, 3.0)))),
        ("leaf.point", "[1, 2, 3]", Root(leaf=Leaf(point=(1.0, 2.0, 3.0)))),
        ("item.0.count", "5", Root(item=(Leaf(count=5),))),
    ],
)
def test_text_is_read_as_the_key_wants_it(key: str, text: str, expected: Root) -> None:
    assert decoding.override(Root(), [(key, text)]) == expected


def test_an_array_of_tables_is_reached_by_place() -> None:
    root = Root(item=(Leaf(), Leaf()))
    changed = decoding.override(root, [("item.1.name", "b")])
    assert changed.item == (Leaf(), Leaf(name="b"))
    assert root.item == (Leaf(), Leaf())


@pytest.mark.parametrize(
    ("key", "text", "said"),
    [
        ("leaf.count", "x", 'at leaf.count: expected an integer, got "x"'),
        ("leaf.count", "", 'at leaf.count: expected an integer, got ""'),
        ("leaf.count", "[1]", "at leaf.count: expected an integer, got [1]"),
        ("leaf.count", "1\ntop = 2", 'at leaf.count: expected an integer, got "1\\ntop = 2"'),
        ("leaf.share", "nan", "at leaf.share: expected a finite number, got nan"),
        ("leaf.flag", "maybe", 'at leaf.flag: expected true or false, got "maybe"'),
        ("leaf.point", "1,2", "at leaf.point: expected 3 numbers or none, got [1, 2]"),
        ("leaf.point", "7", "at leaf.point: expected 3 numbers or none, got [7]"),
        ("laef.count", "1", "at laef.count: unknown key; nearest known: leaf.count"),
        ("leaf.count.x", "1", "at leaf.count.x: unknown key; nearest known: leaf.count"),
        ("count", "1", "at count: unknown key; nearest known: leaf.count"),
        ("item.3.count", "1", "at item.3: expected a place 0 ... 0 and a key, as in item.0.count"),
        (
            "item.-1.count",
            "1",
            "at item.-1: expected a place 0 ... 0 and a key, as in item.0.count",
        ),
        ("item.0", "1", "at item.0: expected a place 0 ... 0 and a key, as in item.0.count"),
    ],
)
def test_a_bad_override_is_told_with_its_path(key: str, text: str, said: str) -> None:
    assert message(decoding.override, Root(), [(key, text)]) == said


def test_a_table_cannot_be_set_as_a_whole() -> None:
    assert message(decoding.override, Root(), [("leaf", "1")]).startswith(
        "at leaf: is a table; set one of its keys: leaf.count, leaf.share"
    )


def test_words_are_split_at_the_first_equals_sign() -> None:
    assert decoding.split_word(" a.b = c=d ") == ("a.b", "c=d")
    assert "is not key=value" in message(decoding.split_word, "=3")
    assert "is not key=value" in message(decoding.split_word, "abc")


def test_plain_values_of_a_configuration_build_it_again() -> None:
    root = Root(leaf=Leaf(point=(1.0, 2.0, 3.0), word="w"), item=(Leaf(), Leaf(flag=True)))
    assert decoding.build(Root, decoding.to_plain(root)) == root


def test_docs_come_from_the_strings_below_the_fields() -> None:
    assert field_docs(Leaf) == {"count": "how many of them", "flag": "whether"}
    tables = {table.name: table for table in describe(Root)}
    assert list(tables) == ["", "leaf", "item.N"]
    assert [key.name for key in tables[""].keys] == ["top"]
    assert tables["leaf"].doc == "[leaf]: a table."
    assert tables["item.N"].keys[0].name == "item.N.count"
    assert tables["leaf"].keys[0].default == "3"


def test_every_key_of_a_pipeline_is_documented() -> None:
    bare = [key.name for table in describe(PipelineConfig) for key in table.keys if not key.doc]
    assert bare == []


def plain_keys(cls: type, prefix: str = "") -> list[tuple[str, Any]]:
    """(dotted name, annotation) of every key that holds a value; arrays of tables by place 0."""
    found = []
    for name, annotation in decoding.hints_of(cls).items():
        if isinstance(annotation, type) and hasattr(annotation, "__dataclass_fields__"):
            found += plain_keys(annotation, f"{prefix}{name}.")
        elif inner := decoding.table_of(annotation)[0]:
            for kind in decoding.variants_of(inner):
                found += plain_keys(kind, f"{prefix}{name}.0.")
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
        str: st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0")),
        type(None): st.none(),
    }
    return strategies[annotation]


KEYS = [
    *(key for key in plain_keys(PipelineConfig) if not key[0].startswith("sink.")),
    *(
        (f"{word}:sink.0.{name}", hint)
        for word, kind in SinkConfig.variants.items()
        for name, hint in plain_keys(kind)
        if name != "type"
    ),
]
"""(dotted name, annotation); a key of a sink stands behind its type and a colon"""


def overrides(key: str, text: str) -> list[tuple[str, str]]:
    """What sets a key of KEYS."""
    word, colon, key = key.rpartition(":")
    return [(key, text), *([("sink.0.type", word)] if colon else [])]


def reach(config: Any, key: str) -> Any:
    for part in key.rpartition(":")[2].split("."):
        config = config[int(part)] if part.isdecimal() else getattr(config, part)
    return config


def attempt(key: str, text: str) -> tuple[PipelineConfig | None, str]:
    """The changed configuration, or what was said against it."""
    try:
        return decoding.override(PipelineConfig(), overrides(key, text)), ""
    except EvsError as error:
        return None, str(error)


@pytest.mark.property
def test_all_keys_of_the_emulator_are_there() -> None:
    names = [name for name, _ in KEYS]
    assert {name for name, _ in plain_keys(RunConfig)} < set(names)
    assert {"render.spp", "sensor.pos_thres", "zmq:sink.0.address", "pace"} < set(names)
    # places apart, these are the names that the nearest known key is looked for in
    bare = {name.rpartition(":")[2].replace(".0.", ".N.") for name in names}
    assert bare <= set(decoding.key_names(PipelineConfig))


@pytest.mark.property
@given(st.data())
def test_any_value_of_any_key_round_trips_through_text(data: st.DataObject) -> None:
    key, annotation = data.draw(st.sampled_from(KEYS))
    value = data.draw(values(annotation))
    config = decoding.override(PipelineConfig(), overrides(key, decoding.to_text(value)))
    assert reach(config, key) == value
    assert type(reach(config, key)) is type(value)
    # through JSON, as reports and recordings carry it
    again = decoding.build(PipelineConfig, json.loads(json.dumps(decoding.to_plain(config))))
    assert again == config


@pytest.mark.property
@given(st.text(), st.text())
def test_any_two_words_give_a_configuration_or_one_line(key: str, text: str) -> None:
    config, said = attempt(key, text)
    assert isinstance(config, PipelineConfig) or said.startswith("at ")


@pytest.mark.property
@given(st.data())
def test_any_text_for_any_key_gives_a_value_of_its_type_or_one_line(data: st.DataObject) -> None:
    key, annotation = data.draw(st.sampled_from(KEYS))
    text = data.draw(st.one_of(st.text(), st.sampled_from(["nan", "[", "1,", "{a=1}", "1e999"])))
    config, said = attempt(key, text)
    if config is None:
        assert said.startswith(f"at {key.rpartition(':')[2]}")
        assert "\n" not in said
    else:
        value = reach(config, key)
        kinds = typing.get_args(annotation) if is_union(annotation) else ()
        allowed = [typing.get_origin(kind) or kind for kind in kinds or (annotation,)]
        assert type(value) in allowed


def test_a_table_of_free_keys_takes_dotted_keys_and_texts() -> None:
    text = 'top = 2\n[ranges]\na = "x(1, 2)"\nin.b = "y"\n[ranges.in.deep]\nc = "z"\n'
    free = decoding.build(Free, tomllib.loads(text))
    assert free == Free({"a": "x(1, 2)", "in.b": "y", "in.deep.c": "z"}, 2)
    texts = {"ranges.in.b": "w(1, 2)", "ranges.new.key": '"none"', "ranges.a": "none"}
    free = decoding.override(free, texts.items())
    assert free.ranges == {"in.deep.c": "z", "in.b": "w(1, 2)", "new.key": "none"}
    plain = json.loads(json.dumps(decoding.to_plain(free)))
    assert decoding.build(Free, plain) == free


def test_mistakes_in_a_table_of_free_keys_are_one_line() -> None:
    for tables, says in (
        ({"ranges": 3}, "at ranges: expected a table, got 3"),
        ({"ranges": {"in": {"a": 3.5}}}, "at ranges.in.a: expected a string, got 3.5"),
        ({"rangs": {}}, "at rangs: unknown key; nearest known: ranges"),
    ):
        assert message(decoding.build, Free, tables) == says
    says = message(decoding.override, Free(), [("ranges", "x")])
    assert says == "at ranges: is a table; set one of its keys, as in ranges.KEY="
