"""Run a Python program whose connections of ZeroMQ are given up sooner.

python impatient_program.py PATIENCE_S -c TEXT | -m MODULE | FILE [ARGUMENT...]
"""

from __future__ import annotations

import runpy
import sys

from evs.drivers.bus import sockets

sockets.PATIENCE_S = int(sys.argv[1])
words = sys.argv[2:]
if words[0] == "-c":
    sys.argv = ["-c", *words[2:]]
    exec(words[1], {"__name__": "__main__"})  # noqa: S102 - as `python -c` does
elif words[0] == "-m":
    sys.argv = words[1:]
    runpy.run_module(words[1], run_name="__main__", alter_sys=True)
else:
    sys.argv = words
    runpy.run_path(words[0], run_name="__main__")
