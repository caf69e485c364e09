"""Keys of the bus: which clients may subscribe to a camera over a network (ZeroMQ's CURVE).

A pair is two small TOML files: NAME.key, which may be given away, and NAME.secret.key, which stays.

A publisher with keys has a ZapAuthenticator, which ZeroMQ asks at each handshake. ZAP (RFC 27):
version, request id, domain, address, identity, mechanism and the client's public key come in;
version, request id, status code, status text, user id and metadata go out.
"""

from __future__ import annotations

import os
import re
import stat
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import zmq
from zmq.utils import z85

from evs.drivers.bus.sockets import Context, Socket, readable
from evs.emulator.base.small_files import is_file
from evs.emulator.config.decoding import read_toml
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
    """Make a new pair."""
    public, secret = zmq.curve_keypair()
    return Keys(public.decode(), secret.decode())


def write_keys(name: str | Path) -> tuple[Path, Path]:
    """Make a pair of key files.

    Args:
        name: Path of both files without their endings.

    Returns:
        NAME.key and NAME.secret.key, which only its owner may read.

    Raises:
        EvsError: One of them exists already: what it opens would be lost.
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
    """Read a public key.

    Args:
        source: A file, or the key itself (40 characters).
        what: Its name in errors.

    Raises:
        EvsError: There is no such file, or it holds no public key.
    """
    if not is_file(Path(source)) and _Z85.fullmatch(source):
        return source
    if source.endswith(SECRET):
        raise EvsError(f"{what} '{source}' is a secret key: give the file that ends in {PUBLIC}")
    return _field(Path(source), "public", what)


def read_secret(file: str | Path, what: str = "key") -> Keys:
    """Read the pair in a NAME.secret.key. Raises EvsError if others may read the file, too."""
    path = Path(file)
    keys = Keys(_field(path, "public", what), _field(path, "secret", what))
    if os.name == "posix" and stat.S_IMODE(path.stat().st_mode) & 0o077:
        raise EvsError(f"{what} '{path}' can be read by others: chmod 600 {path}")
    if zmq.curve_public(keys.secret.encode()).decode() != keys.public:
        raise EvsError(f"{what} '{path}': its two keys are no pair; make others with evs keygen")
    return keys


def read_allowed(sources: Sequence[str]) -> frozenset[str]:
    """Read the public keys of all allowed clients: files, keys written out, folders of files."""
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
    """Make a socket, not yet bound, accept only clients that know its public key."""
    server.set(zmq.CURVE_SERVER, 1)
    server.set(zmq.CURVE_SECRETKEY, keys.secret.encode())


def present(client: Socket, server_public: str, keys: Keys) -> None:
    """Make a socket, not yet connected, talk only to the owner of a public key."""
    client.set(zmq.CURVE_SERVERKEY, server_public.encode())
    client.set(zmq.CURVE_PUBLICKEY, keys.public.encode())
    client.set(zmq.CURVE_SECRETKEY, keys.secret.encode())


def _field(path: Path, key: str, what: str) -> str:
    if not is_file(path):
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


_ENDPOINT = "inproc://zeromq.zap.01"
_MOST_AT_ONCE = 16
"""Handshakes answered at one poll: a crowd of clients waits, the camera does not."""


class ZapAuthenticator:
    """Decides for all sockets of one context which clients connect; the sending thread polls it."""

    def __init__(self, context: Context, allowed: frozenset[str]) -> None:
        """Bind to ZeroMQ's address for handshakes.

        Args:
            context: Of the sockets.
            allowed: Public keys of the clients; none: all that know the publisher's public key.
        """
        self.refused = 0
        """Handshakes that were turned away."""
        self._allowed = {z85.decode(key.encode()) for key in allowed}
        self.socket: Socket = context.socket(zmq.REP)
        self.socket.bind(_ENDPOINT)

    def poll(self) -> None:
        """Answer the handshakes that wait, some at a time."""
        for _ in range(_MOST_AT_ONCE):
            if not readable(self.socket):
                return
            version, request, *fields = self.socket.recv_multipart(zmq.NOBLOCK)
            is_allowed = fields[3:4] == [b"CURVE"] and (
                not self._allowed or fields[4] in self._allowed
            )
            self.refused += not is_allowed
            answer = (b"200", b"OK") if is_allowed else (b"400", b"this key may not come in")
            self.socket.send_multipart([version, request, *answer, b"", b""], zmq.NOBLOCK)

    def close(self) -> None:
        """Accept no more clients."""
        self.socket.close(linger=0)
