"""All or nothing: objects keep their attributes where what is done to them fails."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any


@contextmanager
def unchanged_on_error(*objects: object) -> Iterator[None]:
    """Give objects the attributes back that they have now if the block raises.

    Their lists and dictionaries contain what they contain now. What else is changed in place,
    arrays for example, stays changed.
    """
    kept = [(vars(one), dict(vars(one)), _contents(one)) for one in objects]
    try:
        yield
    except BaseException:
        for attributes, before, contents in reversed(kept):
            attributes.clear()
            attributes.update(before)
            for now, copy in contents:
                now.clear()
                if isinstance(now, dict):
                    now.update(copy)
                else:
                    now.extend(copy)
        raise


def _contents(one: object) -> list[tuple[Any, Any]]:
    """The lists and dictionaries among the attributes, each with a copy."""
    return [(value, value.copy()) for value in vars(one).values() if type(value) in (list, dict)]
