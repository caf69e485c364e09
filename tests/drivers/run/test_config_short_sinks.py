"""`publish` and `record`: keys of a pipeline that stand for a sink."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from evs.drivers.run.config import PUBLISH, PipelineConfig, load
from evs.drivers.sink_config import SinkConfig

SHORT = """
publish = "tcp://127.0.0.1:5560"
publish_wait_for = 2
publish_wait_s = 3.5
publish_control = "tcp://127.0.0.1:5561"
publish_key = "/keys/a.secret.key"
publish_allow = ["/keys/b.key"]
publish_insecure = true
record = "/run.aedat4"
worker = true
[scene]
file = "/x.xml"
[[sink]]
type = "npz"
file = "/run.npz"
worker = true
worker_mb = 8.0
worker_cores = [1]
"""

SINKS = (
    SinkConfig.of(
        type="zmq",
        address="tcp://127.0.0.1:5560",
        wait_for=2,
        wait_s=3.5,
        control="tcp://127.0.0.1:5561",
        key="/keys/a.secret.key",
        allow=("/keys/b.key",),
        insecure=True,
        worker=True,
    ),
    SinkConfig.of(type="npz", file="/run.npz", worker=True, worker_mb=8.0, worker_cores=(1,)),
    SinkConfig.of(type="aedat4", file="/run.aedat4", worker=True),
)


def loaded(folder: Path, text: str) -> PipelineConfig:
    (folder / "run.toml").write_text(text)
    return load(str(folder / "run.toml"))


def test_a_pipeline_file_has_sinks_without_a_table(tmp_path: Path) -> None:
    config = loaded(tmp_path, SHORT)
    assert config.sinks() == SINKS


def test_a_command_has_the_same_sinks() -> None:
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
        "sink.0.worker_mb": "8",
        "sink.0.worker_cores": "1",
        "worker": "true",
    }
    config = load(None, words.items())
    first, second, third = SINKS
    assert config.sinks() == (first, replace(second, worker=True), third)


def test_every_key_of_publish_is_one_of_its_sink() -> None:
    assert set(PUBLISH) <= {name for name in vars(PipelineConfig()) if name.startswith("publish")}
    assert len(PUBLISH) == sum(name.startswith("publish") for name in vars(PipelineConfig()))
    assert set(PUBLISH.values()) <= set(vars(SinkConfig.of("zmq")))


def test_not_to_wait_at_all_is_passed_on() -> None:
    words = [("publish", "tcp://127.0.0.1:1"), ("publish_wait_for", "1"), ("publish_wait_s", "0")]
    (sink,) = load(None, [("scene.file", "/x.xml"), *words]).sinks()
    assert (sink.wait_for, sink.wait_s) == (1, 0.0)


def test_wait_s_alone_changes_nothing() -> None:
    words = [("scene.file", "/x.xml"), ("publish", "tcp://127.0.0.1:1"), ("publish_wait_s", "1")]
    assert load(None, words).sinks() == (SinkConfig.of(type="zmq", address="tcp://127.0.0.1:1"),)
