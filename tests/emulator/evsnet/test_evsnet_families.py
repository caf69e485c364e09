"""Families of networks: the member whose samples come nearest to the light's."""

from __future__ import annotations

from pathlib import Path

import pytest

from evs.emulator.camera.pixel_pipeline import make_event_model
from evs.emulator.config import ModelConfig, RenderConfig
from evs.emulator.evsnet import network_files
from evs.emulator.evsnet.export import export
from evs.emulator.evsnet.network_files import (
    families,
    load_network,
    members,
    nearest_member,
    network_names,
    network_path,
)
from evs.emulator.sensor import SensorParameters
from evs.msgs import EvsError
from reference.networks import random_network

NAMES = ["net_16spp", "net_1spp", "net_4spp", "other_8spp", "paper", "net_0spp", "spp", "_4spp"]


def test_members_bear_the_family_s_name_and_their_samples() -> None:
    assert members("net", NAMES) == {1: "net_1spp", 4: "net_4spp", 16: "net_16spp"}
    assert members("other", NAMES) == {8: "other_8spp"}
    assert members("paper", NAMES) == members("ne", NAMES) == {}
    assert families(NAMES) == ["net", "other"]


@pytest.mark.parametrize(
    ("spp", "chosen"),
    [(1, 1), (2, 1), (3, 4), (4, 4), (7, 4), (9, 16), (16, 16), (999, 16), (0, 16)],
)
def test_the_nearest_member_by_ratio_is_taken(spp: int, chosen: int) -> None:
    assert nearest_member(members("net", NAMES), spp) == f"net_{chosen}spp"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Two members, told apart by their channels, and a network of its own."""
    monkeypatch.setattr(network_files, "_NETWORKS", tmp_path)
    for name, channels in (("net_1spp", 2), ("net_16spp", 4), ("paper", 6)):
        export(random_network(1, channels), tmp_path / f"{name}.onnx")
    return tmp_path


def test_a_family_is_loaded_by_its_name_and_the_samples(folder: Path) -> None:
    assert network_names() == ["net_16spp", "net_1spp", "paper"]
    assert network_path("net", 2) == folder / "net_1spp.onnx"
    assert [load_network("net", spp).channels for spp in (1, 8, 0)] == [2, 4, 4]
    assert load_network("net_1spp", 64).channels == 2
    assert load_network("paper", 64).channels == 6
    with pytest.raises(EvsError, match=r"^no network 'nets'; there is: net, net_1spp, "):
        network_path("nets")
    # a file of that name goes first
    export(random_network(1, 8), folder / "net.onnx")
    assert load_network("net", 1).channels == 8


def test_a_camera_takes_the_member_for_its_light(folder: Path) -> None:
    assert folder.is_dir()
    sensor = SensorParameters("test", 4, 4, 0.2, 0.2)
    for render, channels in (
        (RenderConfig(renderer="path", spp=2), 2),
        (RenderConfig(renderer="path", spp=100), 4),
        # light of `direct` has no noise, however many samples smooth its edges
        (RenderConfig(renderer="direct", spp=1), 4),
    ):
        config = ModelConfig(name="evsnet", network="net")
        model = make_event_model(sensor, config, 1, render.noisy_samples)
        assert model.weights.channels == channels  # type: ignore[attr-defined]
