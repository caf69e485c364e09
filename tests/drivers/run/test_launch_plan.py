"""Launch files: names, order, remapping, and one line for whatever is wrong in them."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from evs.drivers.run.config_reference import field_docs
from evs.drivers.run.launcher.plan import (
    LAUNCH_FILES,
    LaunchPlan,
    NodeConfig,
    find_launch_file,
    read_plan,
)
from evs.emulator.config import decoding
from evs.launch.main import main
from evs.msgs import EvsError

WHOLE = """
[arg]
word = "hello"
count = 3
on = true
[bus]
left = "tcp://127.0.0.1:5570"
right = "auto"
[[node]]
name = "camera_{word}"
run = ["evs", "emulate", "x.xml", "--publish", "{left}"]
publishes = ["left"]
[[node]]
name = "echo"
run = ["evs", "echo", "{events}", "{{{word}}}", "{count}", "{here}"]
subscribes = ["events"]
remap = ["events:=left"]
[[node]]
name = "other"
run = ["evs", "play", "f.aedat4", "--address", "{right}"]
publishes = ["right"]
when = "{on}"
"""


def plan(folder: Path, text: str, *given: str) -> LaunchPlan:
    file = folder / "launch.toml"
    file.write_text(text)
    return read_plan(str(file), given)


def test_names_stand_for_arguments_and_addresses(tmp_path: Path) -> None:
    nodes = {node.name: node for node in plan(tmp_path, WHOLE, "count:=7").nodes}
    assert list(nodes) == ["echo", "camera_hello", "other"]
    left = "tcp://127.0.0.1:5570"
    assert nodes["echo"].run == ("evs", "echo", left, "{hello}", "7", str(tmp_path))
    assert nodes["echo"].subscribes == ("left",)
    assert re.fullmatch(r"tcp://127\.0\.0\.1:\d+", nodes["other"].run[4])


def test_a_camera_waits_for_as_many_as_subscribe(tmp_path: Path) -> None:
    nodes = {node.name: node for node in plan(tmp_path, WHOLE).nodes}
    assert nodes["camera_hello"].run[5:] == ("publish_wait_for=1", "publish_wait_s=60")
    # nobody listens to this one
    assert nodes["other"].run[-1].startswith("tcp://")
    own = WHOLE.replace('"--publish", "{left}"', '"--publish", "{left}", "--wait-for", "0"')
    nodes = {node.name: node for node in plan(tmp_path, own).nodes}
    assert nodes["camera_hello"].run[5:] == ("--wait-for", "0")
    # its pipeline says where it publishes, and for whom it waits
    piped = WHOLE.replace('"x.xml", "--publish", "{left}"', '"pipeline.toml"')
    nodes = {node.name: node for node in plan(tmp_path, piped).nodes}
    assert nodes["camera_hello"].run == ("evs", "emulate", "pipeline.toml")
    played = WHOLE.replace('remap = ["events:=left"]', 'remap = ["events:=right"]')
    nodes = {node.name: node for node in plan(tmp_path, played).nodes}
    assert nodes["other"].run[5:] == ("--wait-for", "1", "--wait", "60")


def test_subscribers_start_first_however_the_file_orders_them(tmp_path: Path) -> None:
    text = '[bus]\na = "auto"\nb = "auto"\n' + "".join(
        f'[[node]]\nname = "{name}"\nrun = ["true"]\n{more}\n'
        for name, more in (
            ("source", 'publishes = ["a"]'),
            ("filter", 'subscribes = ["a"]\npublishes = ["b"]'),
            ("alone", ""),
            ("sink", 'subscribes = ["b"]'),
        )
    )
    assert [one.name for one in plan(tmp_path, text).nodes] == ["alone", "sink", "filter", "source"]
    circle = text.replace('publishes = ["a"]', 'publishes = ["a"]\nsubscribes = ["b"]', 1)
    with pytest.raises(EvsError, match="source, filter subscribe to each other in a circle"):
        plan(tmp_path, circle)


def test_what_is_left_out_is_waited_for_by_nobody(tmp_path: Path) -> None:
    text = WHOLE.replace('remap = ["events:=left"]', 'remap = ["events:=left"]\nwhen = "{on}"')
    nodes = plan(tmp_path, text + '[[node]]\nrun = ["true"]\n', "on:=false").nodes
    assert [node.name for node in nodes] == ["camera_hello", "true"]
    assert nodes[0].run[-1] == "tcp://127.0.0.1:5570"


@pytest.mark.parametrize(
    ("change", "given", "says"),
    [
        (("{count}", "{cuont}"), [], r"at node\.1\.run\.4: no argument or bus 'cuont'.*count"),
        (("", ""), ["cuont:=3"], "no argument 'cuont'; there is: count"),
        (("", ""), ["count=3"], "'count=3' is not NAME:=VALUE"),
        (("events:=left", "events:=middle"), [], r"at node\.1\.remap: no name 'middle'"),
        (("events:=left", "left"), [], "is not NAME:=OTHER"),
        (
            ('subscribes = ["events"]', 'subscribes = ["evens"]'),
            [],
            r"at node\.1\.subscribes: no b",
        ),
        (('name = "other"', 'name = "echo"'), [], "two nodes are named 'echo'"),
        (('when = "{on}"', 'when = "{word}"'), [], "'hello' is not true or false"),
        (('when = "{on}"', 'on_exit = "restrat"'), [], "no on_exit 'restrat'; there is: restart"),
        (('when = "{on}"', "restarts = -1"), [], "restarts: give 0 or more"),
        (('when = "{on}"', 'whne = "x"'), [], r"at node\.2\.whne: unknown key; nearest.*when"),
        (('when = "{on}"', "delay_s = -1.0"), [], "delay_s: give 0 or more"),
        (('when = "{on}"', 'env = ["X"]'), [], r"at node\.2\.env\.0: 'X' is not NAME=VALUE"),
        (('when = "{on}"', 'env = ["1=2"]'), [], "'1=2' is not NAME=VALUE"),
        (('when = "{on}"', 'folder = "{word}"'), [], "folder: there is no folder 'hello'"),
        (('when = "{on}"', 'when = "not {word}"'), [], "'not hello' is not true or false; or comp"),
        (('when = "{on}"', 'when = "{wrod} == a"'), [], "no argument or bus 'wrod'.*word"),
        (('"{count}"', '"{wrod...}"'), [], r"at node\.1\.run\.4: no argument or bus 'wrod'"),
        (('"{count}"', '"{word...}"'), ["word:='"], "cannot be split into words: No closing"),
        (('name = "other"', 'name = "a\\tb"'), [], "no name of a node: give it one that can be pr"),
        (("[arg]", "[args]"), [], "at args: unknown key"),
        (('word = "hello"', "word = [1]"), [], r"at arg\.word: expected one value"),
        (('word = "hello"', 'left = "hello"'), [], "'left' is not a valid, unique name"),
        (('word = "hello"', '"a b" = "hello"'), [], "'a b' is not a valid, unique name"),
        (('run = ["evs", "play"', 'run = ["", "play"'), [], r"node\.2\.run: missing"),
        (
            ("[arg]", '[need]\nrobot = "an MJCF file"\n[arg]'),
            [],
            "needs robot:=VALUE: an MJCF file",
        ),
    ],
)
def test_what_is_wrong_is_one_line(
    tmp_path: Path, change: tuple[str, str], given: list[str], says: str
) -> None:
    with pytest.raises(EvsError, match=says) as caught:
        plan(tmp_path, WHOLE.replace(*change, 1), *given)
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith(f"{tmp_path}/launch.toml: ")


@pytest.mark.parametrize(
    ("when", "given", "runs"),
    [
        ("{on}", [], True),
        ("{on}", ["on:=False"], False),
        ("{on}", ["on:=0"], False),
        ("not {on}", [], False),
        ("not {on}", ["on:=off"], True),
        ("{word} == hello", [], True),
        ("{word}==hello", ["word:=bye"], False),
        ("{word} != hello", [], False),
        ("{word} != ", ["word:="], False),
        ("{count} == 3", [], True),
    ],
)
def test_a_condition_leaves_a_node_out(
    tmp_path: Path, when: str, given: list[str], runs: bool
) -> None:
    nodes = plan(tmp_path, WHOLE.replace('when = "{on}"', f'when = "{when}"'), *given).nodes
    assert ("other" in [node.name for node in nodes]) is runs


def test_one_argument_may_be_many_words_or_none(tmp_path: Path) -> None:
    text = (
        '[arg]\nmore = ""\nwho = "x"\n[[node]]\nname = "n"\nenv = ["A={who}", "{more...}"]\n'
        'run = ["echo", "{more...}", "end"]\n'
    )
    assert plan(tmp_path, text).nodes[0].run == ("echo", "end")
    node = plan(tmp_path, text, "more:=B=1 'C=2 3'").nodes[0]
    assert node.run == ("echo", "B=1", "C=2 3", "end")
    assert node.env == ("A=x", "B=1", "C=2 3")
    with pytest.raises(EvsError, match=r"at node\.0\.run: missing"):
        plan(tmp_path, text.replace('"echo", ', "").replace(', "end"', ""))


def test_a_file_without_nodes_is_refused(tmp_path: Path) -> None:
    with pytest.raises(EvsError, match=r"no \[\[node\]\] to run"):
        plan(tmp_path, "[arg]\n")
    with pytest.raises(EvsError, match="malformed TOML"):
        plan(tmp_path, "[arg\n")
    with pytest.raises(EvsError, match="no launch file 'stero'; evs itself comes with: stereo"):
        find_launch_file("stero")


@pytest.mark.parametrize("file", sorted(LAUNCH_FILES.glob("*.toml")), ids=lambda file: file.stem)
def test_every_launch_file_that_comes_with_evs_is_a_plan(file: Path) -> None:
    needs = decoding.read_toml(file).get("need", {})
    assert read_plan(file.stem, [f"{name}:=x" for name in needs]).nodes


def test_every_key_of_a_node_is_told() -> None:
    docs = field_docs(NodeConfig)
    assert all(docs.values())
    told = re.findall(r"^(\w+) = ", (LAUNCH_FILES / "stereo.toml").read_text(), re.MULTILINE)
    assert set(docs) <= set(told)


def test_show_runs_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "launch.toml"
    file.write_text('[arg]\nx = "a b"\n[[node]]\nname = "n"\nrun = ["no-such-program", "{x}"]\n')
    assert main(["launch", str(file), "--show"]) == 0
    assert "n: no-such-program 'a b'" in capsys.readouterr().out
    assert main(["launch", str(file)]) == 2
    assert "there is no program 'no-such-program'" in capsys.readouterr().err


def test_no_process_to_be_had_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise BlockingIOError(11, "Resource temporarily unavailable")

    monkeypatch.setattr("evs.drivers.run.launcher.guard.subprocess.Popen", refuse)
    file = tmp_path / "launch.toml"
    file.write_text('[[node]]\nname = "n"\nrun = ["true"]\n')
    assert main(["launch", str(file)]) == 2
    line = capsys.readouterr().err
    assert line.count("\n") == 1
    assert "cannot start a process that watches over the launch: Resource temporarily" in line
