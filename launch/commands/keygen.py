"""`evs keygen NAME`: make a key pair, to publish a camera to other machines."""

from __future__ import annotations

import argparse

from evs.launch.support.reinvoke import command


def configure(parser: argparse.ArgumentParser) -> None:
    """The command line of `evs keygen`."""
    parser.usage = "evs keygen NAME"
    parser.epilog = (
        "Writes NAME.key, the public key to share, and NAME.secret.key, which stays on this\n"
        "machine. A camera with a key pair encrypts its traffic; clients need its NAME.key. With\n"
        "--allow, it accepts only clients whose own NAME.key it was given."
    )
    parser.add_argument("name", metavar="NAME", help="name of the key files; may include a folder")


def run(args: argparse.Namespace) -> int:
    """Make the keys, and print how to use them."""
    from evs.drivers.bus.curve_keys import write_keys

    public, secret = write_keys(args.name)
    everywhere = "tcp://0.0.0.0:5560"
    print(f"wrote {public} (give it to who listens) and {secret} (it stays here)")
    print("publish with it, and listen from another machine:")
    publish = ["emulate", "demo", "--publish", everywhere]
    print(f"  {command(*publish, '--key', str(secret))}")
    print(f"  {command('echo', 'tcp://HOST:5560', '--server-key', str(public))}")
    return 0
