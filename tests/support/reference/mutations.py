"""Changes to the bytes of a file, as damage and malice make them."""

from __future__ import annotations

from random import Random

from hypothesis import strategies as st


@st.composite
def mutations(draw: st.DrawFn, data: bytes) -> bytes:
    """A few changes: bytes, whole numbers of interesting sizes, cuts, doublings, insertions."""
    changed = bytearray(data)
    for _ in range(draw(st.integers(1, 4))):
        at = draw(st.integers(0, max(0, len(changed) - 1)))
        how = draw(st.integers(0, 5))
        if how == 0:
            changed[at : at + 1] = bytes([draw(st.integers(0, 255))])
        elif how == 1:
            size = draw(st.sampled_from([2, 4, 8]))
            edges = [0, 1, -1, 7, 2**15, 2**31 - 1, -(2**31), 2**62, 2**32 - 1, len(data)]
            value = draw(st.sampled_from(edges)) % 2 ** (8 * size)
            changed[at : at + size] = value.to_bytes(size, "little")
        elif how == 2:
            del changed[at:]
        elif how == 3:
            del changed[at : at + draw(st.integers(1, 200))]
        elif how == 4:
            changed[at:at] = changed[at : at + draw(st.integers(1, 400))]
        else:
            changed[at:at] = draw(st.binary(max_size=64))
    return bytes(changed)


def changed_by(random: Random, data: bytes) -> bytes:
    """The same kinds of changes by a plain random generator: many more in the same time."""
    changed = bytearray(data)
    for _ in range(random.randint(1, 4)):
        at = random.randrange(max(1, len(changed)))
        how = random.randrange(6)
        if how == 0:
            changed[at : at + 1] = random.randbytes(1)
        elif how == 1:
            size = random.choice((2, 4, 8))
            value = random.choice((0, 1, -1, 7, 2**15, 2**31 - 1, -(2**31), 2**62, len(data)))
            changed[at : at + size] = (value % 2 ** (8 * size)).to_bytes(size, "little")
        elif how == 2:
            del changed[at:]
        elif how == 3:
            del changed[at : at + random.randint(1, 200)]
        elif how == 4:
            changed[at:at] = changed[at : at + random.randint(1, 400)]
        else:
            changed[at:at] = random.randbytes(random.randint(0, 64))
    return bytes(changed)
