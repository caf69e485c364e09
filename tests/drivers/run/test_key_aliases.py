"""Keys that stand for others: old pipeline files and commands work, and new names beside them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from evs.drivers.run.config import PUBLISH, WORKER, PipelineConfig, SinkConfig, load, resolved_key
from evs.msgs import EvsError

OLD = """
publish = "tcp://127.0.0.1:5560"
publish_wait_for = 2
publish_wait_s = 3.5
publish_control = "tcp://127.0.0.1:5561"
publish_key = "/keys/a.secret.key"
publish_allow = ["/keys/b.key"]
publish_insecure = true
record = "/run.aedat4"
aside = true
[scene]
file = "/x.xml"
[[sink]]
type = "npz"
file = "/run.npz"
aside = true
aside_mb = 8.0
aside_cores = [1]
"""

SINKS = (
    SinkConfig(
        type="zmq",
        address="tcp://127.0.0.1:5560",
        wait_for=2,
        wait_s=3.5,
        control="tcp://127.0.0.1:5561",
        key="/keys/a.secret.key",
        allow=("/keys/b.key",),
        insecure=True,
        aside=True,
    ),
    SinkConfig(type="npz", file="/run.npz", aside=True, aside_mb=8.0, aside_cores=(1,)),
    SinkConfig(type="aedat4", file="/run.aedat4", aside=True),
)


def loaded(folder: Path, text: str) -> PipelineConfig:
    (folder / "run.toml").write_text(text)
    return load(str(folder / "run.toml"))


def test_an_old_pipeline_file_means_what_it_meant(tmp_path: Path) -> None:
    config = loaded(tmp_path, OLD)
    assert config.sinks() == SINKS
    # the new name is the same key
    assert loaded(tmp_path, OLD.replace("aside", "worker")) == config


def test_an_old_command_means_what_it_meant() -> None:
    words = {
        "scene.file": "/x.xml",
        "publish": "tcp://127.0.0.1:5560",
        "publish_wait_for": "2",
        "publish_wait_s": "3.5",
        "publish_control": "tcp://127.0.0.1:5561",
        "publish_key": "/keys/a.secret.key",
        "publish_allow": "/keys/b.key",
        "publish_insecure": "true",
        "record": "/run.aedat4",
        "sink.0.type": "npz",
        "sink.0.file": "/run.npz",
        "sink.0.aside_mb": "8",
        "sink.0.aside_cores": "1",
        "aside": "true",
    }
    config = load(None, words.items())
    first, second, third = SINKS
    assert config.sinks() == (first, replace(second, aside=True), third)
    new = {key.replace("aside", "worker"): text for key, text in words.items()}
    assert load(None, new.items()) == config


def test_every_key_of_publish_is_one_of_its_sink() -> None:
    assert set(PUBLISH) <= {name for name in vars(PipelineConfig()) if name.startswith("publish")}
    assert len(PUBLISH) == sum(name.startswith("publish") for name in vars(PipelineConfig()))
    assert set(PUBLISH.values()) | set(WORKER.values()) <= set(vars(SinkConfig()))


def test_not_to_wait_at_all_is_passed_on() -> None:
    words = [("publish", "tcp://127.0.0.1:1"), ("publish_wait_for", "1"), ("publish_wait_s", "0")]
    (sink,) = load(None, [("scene.file", "/x.xml"), *words]).sinks()
    assert (sink.wait_for, sink.wait_s) == (1, 0.0)


def test_wait_s_alone_changes_nothing() -> None:
    words = [("scene.file", "/x.xml"), ("publish", "tcp://127.0.0.1:1"), ("publish_wait_s", "1")]
    assert load(None, words).sinks() == (SinkConfig(type="zmq", address="tcp://127.0.0.1:1"),)


@pytest.mark.parametrize(
    ("key", "meant"),
    [
        ("worker", "aside"),
        ("sink.3.worker", "sink.3.aside"),
        ("sink.0.worker_cores", "sink.0.aside_cores"),
        ("worker_mb", "worker_mb"),
        ("scene.worker", "scene.worker"),
        ("publish", "publish"),
    ],
)
def test_aliases_stand_only_where_their_keys_do(key: str, meant: str) -> None:
    assert resolved_key(key) == meant


def test_one_key_by_two_names_is_refused(tmp_path: Path) -> None:
    with pytest.raises(EvsError, match="at worker: aside is the same key; give one of them"):
        loaded(tmp_path, "worker = true\naside = true\n")
    with pytest.raises(EvsError, match=r"at sink.0.worker_mb: sink.0.aside_mb is the same key"):
        loaded(tmp_path, "[[sink]]\nworker_mb = 1\naside_mb = 1\n")
