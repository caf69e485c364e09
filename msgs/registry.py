"""Registries: tables of "module:name" strings, whose modules are imported at first use."""

from __future__ import annotations

from importlib import import_module
from typing import Any


def load(target: str) -> Any:
    """What a registry's entry names.

    Args:
        target: "module:name", the module's whole dotted name before the colon.

    Returns:
        The class, function or constant of that name.

    Raises:
        ImportError: The module, or a library that it needs, is missing.
    """
    module, _, name = target.partition(":")
    return getattr(import_module(module), name)
