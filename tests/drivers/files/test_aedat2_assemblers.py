"""A DAVIS's frames and IMU samples: the arrays say what a plain loop over the words says."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from evs.drivers.files.aedat2.davis import FrameAssembler, ImuAssembler

pytestmark = pytest.mark.property

WIDTH, HEIGHT = 2, 2
APS, SIGNAL = 1 << 31, 1 << 10
BagMessage = tuple[tuple[int, ...], list[int]]


def plain_frames(words: list[tuple[int, int, int, int]]) -> list[BagMessage]:
    """(begin, exposure's begin and end, end), light, of (x, y, read, adc), a word a microsecond."""
    found: list[BagMessage] = []
    resets: dict[tuple[int, int], int] = {}
    signals: dict[tuple[int, int], int] = {}
    seen: list[tuple[int, int]] = []

    def end() -> None:
        size = WIDTH * HEIGHT
        if len(resets) == size and len(signals) == size:
            reset_at = [t for t, read in seen if read == 0]
            signal_at = [t for t, read in seen if read == 1]
            rolling = signal_at[0] < reset_at[-1]
            stamps = reset_at[0], reset_at[0 if rolling else -1], signal_at[0], signal_at[-1]
            if list(stamps) == sorted(stamps):
                places = [(x, y) for y in range(HEIGHT) for x in range(WIDTH)]
                light = [max(0, resets[place] - signals[place]) for place in places]
                found.append((stamps, light))
        resets.clear()
        signals.clear()
        seen.clear()

    for t, (x, y, read, adc) in enumerate(words):
        if read == 0 and (x, y) in resets:
            end()
        # signals of a frame whose begin is lost
        if read == 1 and (not resets or (x, y) in signals):
            continue
        (signals if read else resets)[x, y] = adc
        seen.append((t, read))
    end()
    return found


reads = st.tuples(st.integers(0, 1), st.integers(0, 1), st.integers(0, 1), st.integers(0, 1023))
whole_frames = st.permutations([(x, y, read) for read in (0, 1) for x in (0, 1) for y in (0, 1)])


@st.composite
def aps_words(draw: st.DrawFn) -> list[tuple[int, int, int, int]]:
    """Whole frames, in any order of their reads, with words missing and too many."""
    words: list[tuple[int, int, int, int]] = []
    for _ in range(draw(st.integers(0, 5))):
        adc = draw(st.integers(0, 1023))
        words += [(*place, (adc * (n + 1)) % 1024) for n, place in enumerate(draw(whole_frames))]
    for extra in draw(st.lists(reads, max_size=3)):
        words.insert(draw(st.integers(0, len(words))), extra)
    for _ in range(draw(st.integers(0, 2))):
        if words:
            words.pop(draw(st.integers(0, len(words) - 1)))
    return words


@given(words=aps_words(), cuts=st.lists(st.integers(0, 50), max_size=4))
def test_frames_are_what_a_plain_loop_finds(
    words: list[tuple[int, int, int, int]], cuts: list[int]
) -> None:
    address = np.array(
        [
            APS | (HEIGHT - 1 - y) << 22 | x << 12 | (SIGNAL if read else 0) | adc
            for x, y, read, adc in words
        ],
        np.int64,
    )
    t = np.arange(len(words))
    taken, got = FrameAssembler(WIDTH, HEIGHT, "eye"), []
    for part in np.split(np.arange(len(words)), sorted(min(cut, len(words)) for cut in cuts)):
        got += list(taken.feed(address[part], t[part]))
    got += list(taken.flush())
    found = [
        (
            (one.begin_us, one.exposure_begin_us, one.exposure_end_us, one.end_us),
            np.rint(one.pixels.reshape(-1) / 65535 * 1023).astype(int).tolist(),
        )
        for one in got
    ]
    # a frame that was whole at a cut does not wait for what may still be written over it
    if not cuts:
        assert found == plain_frames(words)
    else:
        assert len(found) >= len(plain_frames(words)) - len(cuts)
    assert [one.seq for one in got] == list(range(len(got)))


@given(
    words=st.lists(st.tuples(st.integers(0, 7), st.integers(-(2**15), 2**15 - 1)), max_size=40),
    repeats=st.integers(0, 3),
    cuts=st.lists(st.integers(0, 60), max_size=5),
)
def test_samples_are_what_a_plain_loop_finds(
    words: list[tuple[int, int]], repeats: int, cuts: list[int]
) -> None:
    for _ in range(repeats):
        words = words[: len(words) // 2] + [(code, code) for code in range(7)] + words
    codes = [code for code, _ in words]
    expected = [at for at in range(len(words) - 6) if codes[at : at + 7] == list(range(7))]
    address = np.array([APS | 0xC00 | c << 28 | (v & 0xFFFF) << 12 for c, v in words], np.int64)
    t = np.arange(len(words))
    taken, got = ImuAssembler(), []
    for part in np.split(t, sorted(min(cut, len(words)) for cut in cuts)):
        got += taken.feed(address[part], t[part])["t"].tolist()
    taken.flush()
    assert got == expected
    assert taken.lost == len(words) - 7 * len(expected)
