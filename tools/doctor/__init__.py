"""Check a machine for everything that evs needs."""

from evs.tools.doctor.check import BAD, NOTE, OK, Check, guarded
from evs.tools.doctor.machine import (
    check_cores,
    check_disk,
    check_gpu,
    check_memory,
    check_platform,
    check_python,
)
from evs.tools.doctor.packages import CORE, EXTRAS, check_core, check_extras, check_packages

__all__ = [
    "BAD",
    "CORE",
    "EXTRAS",
    "NOTE",
    "OK",
    "Check",
    "check_core",
    "check_cores",
    "check_disk",
    "check_extras",
    "check_gpu",
    "check_memory",
    "check_packages",
    "check_platform",
    "check_python",
    "guarded",
]
