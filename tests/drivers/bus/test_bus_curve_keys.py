"""Keys: files that only their owner reads, and publishers that let in only whom they should."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from evs.drivers.bus import Publisher, Subscription, subscribe
from evs.drivers.bus.address import bindable
from evs.drivers.bus.curve_keys import new_keys, read_allowed, read_public, read_secret, write_keys
from evs.drivers.run import config as pipeline
from evs.launch.main import main
from evs.msgs import EventPacket, EvsError, StreamInfo

ANY_PORT = "tcp://127.0.0.1:0"


@pytest.fixture
def keys(tmp_path: Path) -> Path:
    """A folder with the pairs of a camera, a friend and a stranger."""
    for name in ("camera", "friend", "stranger"):
        write_keys(tmp_path / name)
    return tmp_path


@contextmanager
def publishing(**keys: object) -> Iterator[Publisher]:
    sender = Publisher(ANY_PORT, linger_s=0.1, **keys)  # type: ignore[arg-type]
    sender.open([StreamInfo(346, 260, "cam")])
    try:
        yield sender
    finally:
        sender.close()


def heard(sender: Publisher, stream: Subscription) -> bool:
    """Whether a packet arrives within 5 s; the gate is looked at as often as packets leave."""
    for seq in range(500):
        sender.write(EventPacket(seq, 1000 * seq, 1000 * seq + 1000, 346, 260, camera="cam"))
        if stream.receive(0.01) is not None:
            return True
    return False


def test_a_pair_is_written_once_and_the_secret_is_its_owners(tmp_path: Path) -> None:
    public, secret = write_keys(tmp_path / "camera")
    assert (public.name, secret.name) == ("camera.key", "camera.secret.key")
    assert secret.stat().st_mode & 0o777 == 0o600
    pair = read_secret(secret)
    assert read_public(str(public)) == pair.public == read_public(pair.public)
    assert pair.secret not in public.read_text()
    assert pair.secret not in repr(pair)
    with pytest.raises(EvsError, match="already exists"):
        write_keys(tmp_path / "camera")
    assert read_secret(secret) == pair


def test_what_is_wrong_with_a_key_file_is_said(keys: Path) -> None:
    secret = keys / "camera.secret.key"
    with pytest.raises(EvsError, match="is a secret key: give the file that ends in"):
        read_public(str(secret))
    with pytest.raises(EvsError, match=r"no key file 'nothing\.key'; evs keygen"):
        read_public("nothing.key")
    with pytest.raises(EvsError, match="holds no secret key"):
        read_secret(keys / "camera.key")
    secret.chmod(0o644)
    with pytest.raises(EvsError, match="can be read by others: chmod 600"):
        read_secret(secret)
    secret.chmod(0o600)
    pair = read_secret(secret)
    secret.write_text(f"public = '{new_keys().public}'\nsecret = '{pair.secret}'\n")
    with pytest.raises(EvsError, match="no pair"):
        read_secret(secret)
    with pytest.raises(EvsError, match="cannot write"):
        write_keys(keys / "no" / "folder")


def test_who_is_allowed_is_a_file_a_folder_or_written_out(keys: Path) -> None:
    every = {read_public(str(keys / f"{name}.key")) for name in ("camera", "friend", "stranger")}
    assert read_allowed([str(keys)]) == every
    assert read_allowed([str(keys / "friend.key"), min(every)]) <= every
    (keys / "empty").mkdir()
    with pytest.raises(EvsError, match="no file in the folder"):
        read_allowed([str(keys / "empty")])


def test_with_the_publishers_key_one_is_let_in(keys: Path) -> None:
    with publishing(key=str(keys / "camera.secret.key")) as sender:
        server_key = str(keys / "camera.key")
        with subscribe(sender.address, server_key=server_key) as stream:
            assert heard(sender, stream)


@pytest.mark.parametrize("wrong", ["", "stranger.key"])
def test_without_the_publishers_key_one_is_told(keys: Path, wrong: str) -> None:
    server_key = str(keys / wrong) if wrong else ""
    with publishing(key=str(keys / "camera.secret.key")) as sender:
        with subscribe(sender.address, server_key=server_key) as stream:
            with pytest.raises(EvsError, match="does not let us in") as caught:
                heard(sender, stream)
            assert "\n" not in str(caught.value)
        assert sender.subscribers == 0


def test_only_whom_it_allows(keys: Path) -> None:
    secret, server_key = str(keys / "camera.secret.key"), str(keys / "camera.key")
    with publishing(key=secret, allow=[str(keys / "friend.key")]) as sender:
        friend, stranger = (str(keys / f"{name}.secret.key") for name in ("friend", "stranger"))
        for unknown in ("", stranger):
            with (
                subscribe(sender.address, server_key=server_key, key=unknown) as stream,
                pytest.raises(EvsError, match="does not allow yours"),
            ):
                heard(sender, stream)
        assert sender.subscribers == 0
        with subscribe(sender.address, server_key=server_key, key=friend) as stream:
            assert heard(sender, stream)


def test_a_publisher_without_keys_is_no_publisher_with_keys(keys: Path) -> None:
    with (
        publishing() as sender,
        subscribe(sender.address, server_key=str(keys / "camera.key")) as stream,
        pytest.raises(EvsError, match="it has no keys"),
    ):
        heard(sender, stream)


def test_keys_or_a_word_open_the_door_to_other_machines(keys: Path) -> None:
    with pytest.raises(EvsError, match=r"safe without keys.*evs keygen.*insecure=true"):
        Publisher("tcp://0.0.0.0:0")
    assert bindable("tcp://0.0.0.0:5560", open_to_others=True) == "tcp://0.0.0.0:5560"
    for options in ({"key": str(keys / "camera.secret.key")}, {"insecure": True}):
        sender = Publisher("tcp://0.0.0.0:0", **options)  # type: ignore[arg-type]
        assert sender.close()["packets_sent"] == 0


def test_half_given_keys_are_refused(keys: Path) -> None:
    with pytest.raises(EvsError, match="allow needs key"):
        Publisher(ANY_PORT, allow=[str(keys / "friend.key")])
    with pytest.raises(EvsError, match="key needs server_key"):
        subscribe("tcp://127.0.0.1:5560", key=str(keys / "friend.secret.key"))


def test_keygen_says_what_to_do_next(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["keygen", str(tmp_path / "arm")]) == 0
    out = capsys.readouterr().out
    assert f"--key {tmp_path}/arm.secret.key" in out
    assert f"--server-key {tmp_path}/arm.key" in out
    assert main(["keygen", str(tmp_path / "arm")]) == 2
    assert "give the new keys another name" in capsys.readouterr().err


def test_a_pipeline_finds_its_keys_beside_itself(keys: Path) -> None:
    written_out = read_public(str(keys / "friend.key"))
    file = keys / "pipeline.toml"
    file.write_text(
        f"""publish = "tcp://0.0.0.0:0"
publish_key = "camera.secret.key"
publish_allow = ["friend.key", "{written_out}"]
[scene]
file = "x.xml"
[[sink]]
type = "zmq"
address = "tcp://127.0.0.1:0"
key = "camera.secret.key"
allow = ["."]
"""
    )
    words = [("publish_allow", f"{keys}/friend.key, {written_out}"), ("sink.0.allow", "none")]
    given = pipeline.load(str(file), words)
    assert given.publish_allow == (f"{keys}/friend.key", written_out)
    assert given.sink[0].allow == ()
    with pytest.raises(EvsError, match="at publish_key: needs publish"):
        pipeline.load(str(file), [("publish", "")])
    first, second = pipeline.load(str(file)).sinks()
    assert (first.key, first.allow) == (str(keys / "camera.secret.key"), (str(keys / "."),))
    assert second.key == str(keys / "camera.secret.key")
    assert second.allow == (str(keys / "friend.key"), written_out)
    pipeline.make_sink(second)
