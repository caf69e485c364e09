"""Stress cases, each with its bound and its measurement.

Tests run them at full length, `evs doctor` in a short form.
"""

from evs_lab.stress.stress_case import (
    GROUPS,
    CaseResult,
    Measurement,
    StressCase,
    cases_of,
    run_case,
    run_cases,
)

__all__ = [
    "GROUPS",
    "CaseResult",
    "Measurement",
    "StressCase",
    "cases_of",
    "run_case",
    "run_cases",
]
