"""One end of a bad line: a network card of ours, whose packets are late, out of order or lost.

    python rough_program.py FD CARD ADDRESS/24 DELAY_MS JITTER_MS LOSS SEED

FD is a datagram socket to the program at the other end. Stands in for the kernel's netem, which
many machines have not got: a TUN device gives its packets to a program.
"""

from __future__ import annotations

import fcntl
import heapq
import os
import random
import select
import socket
import struct
import subprocess
import sys

from evs.drivers.clock import monotonic_s

_TUNSETIFF = 0x400454CA
_IFF_TUN, _IFF_NO_PI = 0x0001, 0x1000
_LONGEST = 65536
_MOST_WAITING = 10_000
"""packets under way; who sends more loses them, as in a router"""


def open_card(name: str, address: str) -> int:
    """A network card whose packets are read from, and written to, the result."""
    card = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
    fcntl.ioctl(card, _TUNSETIFF, struct.pack("16sH", name.encode(), _IFF_TUN | _IFF_NO_PI))
    subprocess.run(["ip", "address", "add", address, "dev", name], check=True)
    subprocess.run(["ip", "link", "set", name, "mtu", "1400", "up"], check=True)
    return card


def main() -> None:
    fd, name, address, *rest = sys.argv[1:]
    delay_s, jitter_s, loss = (float(rest[i]) / scale for i, scale in enumerate((1e3, 1e3, 1)))
    chance = random.Random(int(rest[3]))
    line = socket.socket(fileno=int(fd))
    line.setblocking(False)
    card = open_card(name, address)
    print("ready", flush=True)
    waiting: list[tuple[float, int, bytes]] = []
    count = 0
    while True:
        wait_s = max(0.0, waiting[0][0] - monotonic_s()) if waiting else None
        ready, _, _ = select.select([card, line], [], [], wait_s)
        if card in ready:
            packet = os.read(card, _LONGEST)
            count += 1
            if chance.random() >= loss and len(waiting) < _MOST_WAITING:
                due_s = monotonic_s() + delay_s + jitter_s * (2 * chance.random() - 1)
                heapq.heappush(waiting, (due_s, count, packet))
        if line in ready:
            packet = line.recv(_LONGEST)
            if not packet:
                return
            os.write(card, packet)
        while waiting and waiting[0][0] <= monotonic_s():
            try:
                line.send(heapq.heappop(waiting)[2])
            except BlockingIOError:
                # the other end does not keep up: lost, too
                continue
            except OSError:
                return


if __name__ == "__main__":
    main()
