"""Saved states: named arrays as bytes, checks, and tests whether a state fits a world."""

from evs.emulator.state.blob import MAX_BYTES, described, pack, unpack
from evs.emulator.state.resumable import (
    MOST,
    Resumable,
    Saved,
    check_identity,
    check_like,
    joined,
    number,
    numbers,
    part,
    unpack_here,
    whole,
    word,
    words,
)

__all__ = [
    "MAX_BYTES",
    "MOST",
    "Resumable",
    "Saved",
    "check_identity",
    "check_like",
    "described",
    "joined",
    "number",
    "numbers",
    "pack",
    "part",
    "unpack",
    "unpack_here",
    "whole",
    "word",
    "words",
]
