"""What the tests of whole programs share."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from links.link import Link, NoLinkError


@pytest.fixture
def link() -> Iterator[Link]:
    """Two network namespaces with a cable between them, for this test alone."""
    try:
        made = Link()
    except NoLinkError as reason:
        pytest.skip(str(reason))
    with made:
        yield made
