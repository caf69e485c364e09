"""AEDAT4's trigger packets ("TRIG" of dv-processing): an instant and what happened at it."""

from __future__ import annotations

import flatbuffers

from evs.drivers.files.aedat4.layout import CorruptDataError, Flat, list_body
from evs.drivers.files.integrity import MAX_STAMP_US
from evs.msgs import Triggers, empty_triggers

# fields of a trigger's table
_T, _KIND = 0, 1
_FIELDS = 2


def triggers_body(triggers: Triggers) -> bytes:
    """An uncompressed packet body."""
    builder = flatbuffers.Builder(32 * len(triggers) + 64)
    tables = []
    for t_us, kind in triggers.tolist():
        builder.StartObject(_FIELDS)
        builder.PrependInt64Slot(_T, t_us, 0)
        builder.PrependInt8Slot(_KIND, kind, 0)
        tables.append(builder.EndObject())
    return list_body(builder, tables, b"TRIG")


def parse_triggers(body: bytes) -> Triggers:
    """The triggers of an uncompressed packet body. Raises CorruptDataError."""
    flat = Flat(body, b"TRIG")
    elements_at = flat.field(flat.root(), 0)
    if elements_at is None:
        return empty_triggers()
    start, count = flat.vector(elements_at, 4)
    # a trigger takes its place in the list and a link to the layout of its fields
    if 8 * count > len(body):
        raise CorruptDataError(f"{count} triggers do not fit a buffer of {len(body)} bytes")
    triggers = empty_triggers(count)
    for row in range(count):
        at = start + 4 * row
        table = at + flat.number("<I", at)
        for name, field, kind in (("t", _T, "<q"), ("kind", _KIND, "<b")):
            value_at = flat.field(table, field)
            triggers[name][row] = 0 if value_at is None else flat.number(kind, value_at)
    stamps = triggers["t"]
    beyond = (stamps < -MAX_STAMP_US) | (stamps > MAX_STAMP_US)
    if beyond.any() or (stamps[1:] < stamps[:-1]).any():
        raise CorruptDataError("the triggers' time stamps run backwards or are beyond 2^62 us")
    return triggers
