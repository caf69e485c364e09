"""Keys of the bus: who may listen to a camera that other machines can reach (ZeroMQ's CURVE).

A pair is two small TOML files: NAME.key, which may be given away, and NAME.secret.key, which stays.
"""

from __future__ import annotations

import os
import re
import stat
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import zmq

from evs.drivers.bus.sockets import Socket
from evs.drivers.settings import read_toml
from evs.msgs import EvsError

PUBLIC, SECRET = ".key", ".secret.key"
"""Endings of the two files of a pair."""

_Z85 = re.compile(r"[0-9A-Za-z.\-:+=^!/*?&<>()\[\]{}@%$#]{40}")
"""32 bytes as ZeroMQ writes keys (RFC 32)."""


@dataclass(frozen=True)
class Keys:
    """A pair of keys, 40 characters each."""

    public: str
    secret: str = field(repr=False)


def new_keys() -> Keys:
    """A pair that nobody else has."""
    public, secret = zmq.curve_keypair()
    return Keys(public.decode(), secret.decode())


def write_keys(name: str | Path) -> tuple[Path, Path]:
    """Make a pair; out: the files NAME.key and NAME.secret.key (which only its owner may read).

    Raises EvsError where one of them is there already: what it opens would be lost.
    """
    keys = new_keys()
    public, secret = Path(f"{name}{PUBLIC}"), Path(f"{name}{SECRET}")
    for path in (public, secret):
        # a link to nowhere is there, too
        if os.path.lexists(path):
            raise EvsError(f"'{path}' already exists: give the new keys another name")
    text = (
        f'# a public key of evs: give it to whoever talks to its owner\npublic = "{keys.public}"\n'
    )
    _write_new(public, 0o644, text)
    text = f"# a secret key of evs: it never leaves this machine\npublic = {keys.public!r}\n"
    try:
        _write_new(secret, 0o600, f"{text}secret = {keys.secret!r}\n")
    except EvsError:
        # half a pair is of no use
        public.unlink(missing_ok=True)
        raise
    return public, secret


def read_public(source: str, what: str = "key") -> str:
    """The public key in a file, or written out (40 characters). In: what, as errors name it."""
    if not Path(source).is_file() and _Z85.fullmatch(source):
        return source
    if source.endswith(SECRET):
        raise EvsError(f"{what} '{source}' is a secret key: give the file that ends in {PUBLIC}")
    return _field(Path(source), "public", what)


def read_secret(file: str | Path, what: str = "key") -> Keys:
    """The pair in a NAME.secret.key. Raises EvsError where others may read it, too."""
    path = Path(file)
    keys = Keys(_field(path, "public", what), _field(path, "secret", what))
    if os.name == "posix" and stat.S_IMODE(path.stat().st_mode) & 0o077:
        raise EvsError(f"{what} '{path}' can be read by others: chmod 600 {path}")
    if zmq.curve_public(keys.secret.encode()).decode() != keys.public:
        raise EvsError(f"{what} '{path}': its two keys are no pair; make others with evs keygen")
    return keys


def read_allowed(sources: Sequence[str]) -> frozenset[str]:
    """The public keys of all who may come in: files, keys written out, folders of files."""
    found: set[str] = set()
    for source in sources:
        if Path(source).is_dir():
            files = [str(one) for one in sorted(Path(source).glob(f"*{PUBLIC}"))]
            files = [one for one in files if not one.endswith(SECRET)]
            if not files:
                raise EvsError(f"at allow: no file in the folder '{source}' ends in {PUBLIC}")
            found |= {read_public(one, "allow") for one in files}
        else:
            found.add(read_public(source, "allow"))
    return frozenset(found)


def guard(server: Socket, keys: Keys) -> None:
    """Make a socket, not yet bound, take only clients that know its public key."""
    server.set(zmq.CURVE_SERVER, 1)
    server.set(zmq.CURVE_SECRETKEY, keys.secret.encode())


def present(client: Socket, server_public: str, keys: Keys) -> None:
    """Make a socket, not yet connected, talk only to the owner of a public key."""
    client.set(zmq.CURVE_SERVERKEY, server_public.encode())
    client.set(zmq.CURVE_PUBLICKEY, keys.public.encode())
    client.set(zmq.CURVE_SECRETKEY, keys.secret.encode())


def _field(path: Path, key: str, what: str) -> str:
    if not path.is_file():
        raise EvsError(f"{what}: no key file '{path}'; evs keygen NAME makes keys")
    value = read_toml(path).get(key)
    if not isinstance(value, str) or not _Z85.fullmatch(value):
        raise EvsError(f"{what} '{path}' holds no {key} key; evs keygen NAME makes keys")
    return value


def _write_new(path: Path, mode: int, text: str) -> None:
    try:
        handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode)
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            file.write(text)
    except OSError as reason:
        raise EvsError(f"cannot write '{path}': {reason.strerror}") from None
