"""The names of evs.tools.testing, each imported on first use."""

from .evidence import replay as replay
from .plugin import evs_loop as evs_loop
from .pushes import Push as Push
from .run import Run as Run, Trace as Trace
from .runner import LoopRunner as LoopRunner
