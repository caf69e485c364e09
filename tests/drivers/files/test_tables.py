"""Tables of events as other programs write them, in text, NPZ, NPY and HDF5."""

from __future__ import annotations

import warnings
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from evs.drivers import files
from evs.drivers.files import layouts
from evs.drivers.files.integrity import DamagedPacketWarning, TornTailWarning
from evs.launch.main import main
from evs.msgs import EvsError, make_events

h5py = pytest.importorskip("h5py")

COUNT = 3000
random = np.random.default_rng(42)
T = np.cumsum(random.integers(1, 75, COUNT))
X, Y = random.integers(0, 346, COUNT), random.integers(0, 260, COUNT)
X[1], Y[2] = 345, 259
P = random.integers(0, 2, COUNT)
EVENTS = make_events(T, X, Y, P)
SIGN = np.where(P, 1, -1)
NONE = np.zeros(COUNT, int)


def text(*columns: Any, before: str = "", comma: str = ",", encoding: str = "utf-8") -> bytes:
    rows = (comma.join(str(value) for value in row) for row in zip(*columns, strict=True))
    return (before + "\n".join(rows) + "\n").encode(encoding)


SECONDS = [f"{t / 1e6:.6f}" for t in T]
QUOTED = [[f'"{value}"' for value in column] for column in (T, X, Y, P)]

TEXTS: dict[str, tuple[bytes, str]] = {
    "t,x,y,p": (text(T, X, Y, P), "columns t, x, y, p; times in us"),
    "x,y,p,t": (text(X, Y, P, T), "columns x, y, p, t; times in us"),
    "geometry": (
        text(X, Y, P, T, before="%geometry:346,260\n"),
        "columns x, y, p, t; times in us",
    ),
    "x,y,t,p": (text(X, Y, T, SIGN, comma=" "), "columns x, y, t, p; times in us"),
    "y,x,b,p,t": (text(Y, X, NONE, P, T), "columns y, x, -, p, t; times in us"),
    "seconds": (text(SECONDS, X, Y, P, comma=" "), "columns t, x, y, p; times in s"),
    "x y t p in s": (text(X, Y, SECONDS, P), "columns x, y, t, p; times in s"),
    "float us": (text(T + 0.5, X, Y, P), "columns t, x, y, p; times in us"),
    "ns": (text(T * 1000 + 7, X, Y, P, before="t_ns,x,y,p\n"), ""),
    "named": (text(P, Y, X, T, before="pol,row,col,timestamp\n"), "times in us"),
    "byte-order mark": (text(T, X, Y, P, before="\ufefft,x,y,p\n"), "times in us"),
    "UTF-16": (text(T, X, Y, P, before="t,x,y,p\n", encoding="utf-16"), "times in us"),
    "quoted": (text(*QUOTED, before='"t","x","y","p"\n'), "times in us"),
    "Unix ns": (text(T * 1000 + 17 * 10**17, X, Y, P), "columns t, x, y, p; times in ns"),
}


@pytest.mark.parametrize("name", TEXTS)
def test_text_of_others_is_read(tmp_path: Path, name: str) -> None:
    data, read_as = TEXTS[name]
    if name == "float us":
        # a fraction of a second as a float that is no fraction of a sensor's clock
        data = data.replace(b".5,", b".25,")
    path = tmp_path / "a.csv"
    path.write_bytes(data)
    found = files.summary(path)
    assert found.read_as == read_as
    events = files.read(path)
    base = 17 * 10**14 if name == "Unix ns" else 0
    assert events.tolist() == make_events(T + base, X, Y, P).tolist()
    assert (events.stream.width, events.stream.height) == (346, 260)
    assert (found.events, found.damaged_packets, found.backwards) == (COUNT, 0, "")


def test_lines_of_utf_16_keep_their_offsets(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("t,x,y,p\n5,1,2,1\nbad\n7,3,4,0\n9,", encoding="utf-16")
    with (
        pytest.warns(DamagedPacketWarning, match=f"at byte {2 + 2 * 16}:"),
        pytest.warns(TornTailWarning, match=f"4 bytes at offset {2 + 2 * 28}"),
    ):
        assert files.read(path).tolist() == [(5, 1, 2, 1), (7, 3, 4, 0)]
    assert files.repair(path).cut_bytes == 4
    assert path.read_text("utf-16").endswith("7,3,4,0\n")


def structured(**columns: Any) -> Any:
    table = np.zeros(COUNT, [(name, column.dtype) for name, column in columns.items()])
    for name, column in columns.items():
        table[name] = column
    return table


U2 = {"x": X.astype(np.uint16), "y": Y.astype(np.uint16)}
VID2E = {"x": X.astype("i2"), "y": Y.astype("i2"), "p": SIGN.astype("i1")}

ARRAYS: dict[str, tuple[dict[str, Any], str]] = {
    "TimeLens": ({**U2, "timestamp": T, "polarity": P.astype("u1")}, "times in us"),
    "vid2e": ({**VID2E, "t": T * 1000 + 300}, "times in ns"),
    "vid2e's types in us": ({**VID2E, "t": T // 40}, "times in us"),
    "float seconds": ({**U2, "t": T / 1e6, "p": SIGN.astype(float)}, "times in s"),
    "float us": ({**U2, "ts": T.astype(float), "pol": P.astype(bool)}, "times in us"),
    "structured": ({"events": structured(t=T, p=P, **U2)}, "times in us"),
    "a table": ({"events": np.stack([X, Y, T, P], 1)}, "columns x, y, t, p; times in us"),
    "by columns": ({"a": np.array([T, X, Y, P], float).T}, "columns t, x, y, p; times in us"),
}


@pytest.mark.parametrize("name", ARRAYS)
def test_arrays_of_others_are_read(tmp_path: Path, name: str) -> None:
    arrays, read_as = ARRAYS[name]
    path = tmp_path / "a.npz"
    np.savez_compressed(path, **arrays)
    stamps = T // 40 if name == "vid2e's types in us" else T
    found = files.summary(path)
    assert found.read_as == read_as
    assert files.read(path).tolist() == make_events(stamps, X, Y, P).tolist()
    if len(arrays) == 1:
        single = tmp_path / "a.npy"
        np.save(single, next(iter(arrays.values())))
        assert files.summary(single).read_as == read_as
        assert files.read(single).tobytes() == EVENTS.tobytes()


def save_h5(path: Path, sets: dict[str, Any]) -> None:
    with h5py.File(path, "w") as file:
        for name, values in sets.items():
            file.create_dataset(name, data=values)


M3ED = {"t": T, "p": P, **U2}
RIGHT = {"t": T[:9], "x": X[:9], "y": Y[:9], "p": P[:9]}

HDF5: dict[str, tuple[dict[str, Any], str]] = {
    "rpg": ({"events/ts": T / 1e6, "events/xs": X, "events/ys": Y, "events/ps": P}, "times in s"),
    "rpg in us": (
        {"events/ts": T + 0.25, "events/xs": X, "events/ys": Y, "events/ps": P},
        "times in us",
    ),
    "float us": ({"events/t": T + 0.0, "events/x": X, "events/y": Y, "events/p": P}, "times in us"),
    "v2e": ({"events": np.stack([T, X, Y, P], 1).astype("u4")}, "columns t, x, y, p; times in us"),
    "compound": ({"events": structured(t=T, p=P, **U2)}, "times in us"),
    "root": ({"t": T, "x": X, "y": Y, "p": P}, "times in us"),
    "MVSEC": (
        {
            "davis/left/events": np.stack([X, Y, 1.5e9 + T / 1e6, SIGN], 1),
            "davis/right/events": np.stack([X, Y, 1.5e9 + T / 1e6, SIGN], 1)[:9],
        },
        "columns x, y, t, p; times in s",
    ),
    "M3ED": (
        {f"prophesee/left/{name}": values for name, values in M3ED.items()}
        | {f"prophesee/right/{name}": values for name, values in RIGHT.items()}
        | {"prophesee/left/calib/resolution": [1280, 720]},
        "times in us",
    ),
}


@pytest.mark.parametrize("name", HDF5)
def test_hdf5_of_others_is_read(tmp_path: Path, name: str) -> None:
    sets, read_as = HDF5[name]
    path = tmp_path / "a.hdf5"
    save_h5(path, sets)
    found = files.summary(path)
    assert found.read_as == read_as
    begin_us = 1_500_000_000_000_000 if name == "MVSEC" else 0
    two = len(found.streams) == 2
    with warnings.catch_warnings():
        warnings.simplefilter("ignore" if two else "error", files.LeftOutWarning)
        events = files.read(path)
    assert events.tolist() == make_events(T + begin_us, X, Y, P).tolist()
    assert events.stream.width == (1280 if name == "M3ED" else 346)
    if two:
        assert list(found.left_out.values()) == [9]
        with pytest.warns(files.LeftOutWarning, match=f"{COUNT} events of stream .*left"):
            assert len(files.read(path, stream="right")) == 9


SPARSE_T = np.arange(1, 1501) * 100_001
SPARSE = {
    "t": SPARSE_T,
    "x": np.resize(np.array([0, 639], "u2"), 1500),
    "y": np.resize(np.array([479, 0, 7], "u2"), 1500),
    "p": np.resize(np.array([1, 0, 0, 1, 0], "u1"), 1500),
}
S, US = SPARSE_T / 1e6, SPARSE_T.astype("i8")
SIGNED = np.where(SPARSE["p"], 1, -1).astype("i1")
PIXELS = {"x": SPARSE["x"].astype("i2"), "y": SPARSE["y"].astype("i2")}


def under(path: str, **columns: Any) -> dict[str, Any]:
    """The columns of a group; those of `SPARSE` where none are given."""
    columns = {**{name: SPARSE[name] for name in "xyp"}, **columns}
    return {f"{path}{name}": column for name, column in columns.items()}


def rows(order: str, **columns: Any) -> Any:
    return np.stack([{**SPARSE, **columns}[name] for name in order], 1)


def table_of(dtype: list[tuple[str, str]]) -> Any:
    table = np.zeros(1500, dtype)
    for name in "xytp":
        table[name] = SPARSE[name]
    return table


RPG = {"events/xs": SPARSE["x"], "events/ys": SPARSE["y"], "events/ps": SIGNED.astype(float)}
INDEX = np.arange(3)
KNOWN: dict[str, dict[str, Any]] = {
    "rpg.h5": {**RPG, "events/ts": S},
    "DSEC.h5": {**under("events/", t=US.astype("u4")), "ms_to_idx": INDEX, "t_offset": 0},
    "DSEC as floats.h5": {**under("events/", t=US + 0.25), "ms_to_idx": INDEX},
    "DSEC at the root.h5": {**under("", t=US), "ms_to_idx": INDEX},
    "M3ED.h5": under("prophesee/left/", t=US, ms_map_idx=INDEX),
    "M3ED's right.h5": under("prophesee/right/", t=US),
    "MVSEC.h5": {"davis/left/events": rows("xytp", t=1.5e9 + S, p=SIGNED)},
    "MVSEC's right.h5": {"davis/right/events": rows("xytp", t=S, p=SIGNED)},
    "v2e.h5": {"events": rows("txyp").astype("u4")},
    "Metavision.h5": {"CD/events": table_of([("x", "u2"), ("y", "u2"), ("p", "i2"), ("t", "i8")])},
    "vid2e.npz": {**PIXELS, "t": US * 1000 + 7, "p": SIGNED},
    "TimeLens.npz": {
        "x": SPARSE["x"],
        "y": SPARSE["y"],
        "timestamp": US,
        "polarity": SPARSE["p"],
    },
    "tonic.npz": {"events": table_of([("x", "i2"), ("y", "i2"), ("t", "i8"), ("p", "?")])},
}


@pytest.mark.parametrize("count", [1500, 12])
@pytest.mark.parametrize("name", KNOWN)
def test_a_known_layout_has_its_unit_however_few_events_there_are(
    tmp_path: Path, name: str, count: int
) -> None:
    """Two and a half minutes with 5e-5 events per pixel and second; the first second of them."""
    path = tmp_path / name
    columns = {key: one[:count] if np.ndim(one) else one for key, one in KNOWN[name].items()}
    save = save_h5 if path.suffix == ".h5" else lambda path, sets: np.savez(path, **sets)
    save(path, columns)
    base = 1_500_000_000_000_000 if name == "MVSEC.h5" else 0
    found = make_events(*(SPARSE[field][:count] for field in "txyp"))
    found["t"] += base
    assert files.read(path).tobytes() == found.tobytes()


def test_whole_seconds_of_few_events_are_seconds(tmp_path: Path) -> None:
    path = tmp_path / "a.h5"
    sets = {f"events/{name}s": np.array([3.0, 4.0]) for name in "txy"}
    save_h5(path, {**sets, "events/ps": np.ones(2)})
    assert files.read(path)["t"].tolist() == [3_000_000, 4_000_000]


@pytest.mark.integration
@pytest.mark.parametrize("count", [1500, 12])
def test_seconds_that_would_last_for_years_are_refused(tmp_path: Path, count: int) -> None:
    path = tmp_path / "a.h5"
    save_h5(path, {key: one[:count] for key, one in {**RPG, "events/ts": US + 0.25}.items()})
    with pytest.raises(EvsError, match="does not state the unit of its times"):
        files.read(path)
    assert files.read(path, unit="us")["t"].tolist() == SPARSE_T[:count].tolist()


AMBIGUOUS: dict[str, tuple[bytes, str]] = {
    "polarity 0 to 3": (
        text(T, X, Y, np.arange(COUNT) % 4, before="t,x,y,p\n"),
        "polarities 0, 1, 2, 3, and evs knows 1 for ON, 0 or -1 for OFF",
    ),
    "polarity 1 and 2": (text(T, X, Y, P + 1, before="t,x,y,p\n"), "polarities 1, 2, and"),
    "no polarity": (text(T, X, Y, X), "no order fits .* --columns t,x,y,p"),
    "no time": (text(X, X, Y, P), "no order fits .* --columns t,x,y,p"),
    "two orders": (text(T, X, P, P * 0 + T, Y), "--columns t,x,y,p"),
    "x and y exchanged": (text(T, Y, X, P), "260 x 346 px.*--columns t,y,x,p, or t,x,y,p"),
    "us or ns": (text(T * 1000, X, Y, P), r"us \(.* s\) or ns \(.* s\): .*--unit us"),
    "s or ms": ([], ""),  # type: ignore[dict-item]
}
AMBIGUOUS["s or ms"] = (
    text([f"{t / 1e3:.3f}" for t in T], X, Y, P),
    r"may be s \(.*\) or ms \(.*\) or us \(.*\): .*--unit s",
)


@pytest.mark.parametrize("name", AMBIGUOUS)
def test_what_is_ambiguous_is_refused_with_the_fix(tmp_path: Path, name: str) -> None:
    data, says = AMBIGUOUS[name]
    path = tmp_path / "a.csv"
    path.write_bytes(data)
    with pytest.raises(EvsError, match=says) as caught:
        files.read(path)
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.parametrize(
    ("name", "save", "options"),
    [
        ("a.csv", lambda path: path.write_bytes(text(T, Y, X, P)), {"columns": "t,y,x,p"}),
        ("a.csv", lambda path: path.write_bytes(text(T * 1000, X, Y, P)), {"unit": "ns"}),
        ("a.txt", lambda path: path.write_bytes(text(T / 1e3, X, Y, P)), {"unit": "ms"}),
        (
            "a.csv",
            lambda path: path.write_bytes(text(Y, X, T, P, before="v,u,when,sign\n")),
            {"columns": "t=when,x=u,y=v,p=sign"},
        ),
        (
            "a.npz",
            lambda path: np.savez(path, when=T, u=X, v=Y, sign=P),
            {"columns": "t=when,x=u,y=v,p=sign", "unit": "us"},
        ),
        ("a.npz", lambda path: np.savez(path, Y, X, P, T), {"columns": "y,x,p,t"}),
        ("a.npy", lambda path: np.save(path, np.stack([T, Y, X, P], 1)), {"columns": "t,y,x,p"}),
        (
            "a.h5",
            lambda path: save_h5(path, {"when": T, "u": X, "v": Y, "sign": P}),
            {"columns": "t=when,x=u,y=v,p=sign"},
        ),
    ],
)
def test_the_user_names_columns_and_unit(
    tmp_path: Path, name: str, save: Callable[[Path], object], options: dict[str, Any]
) -> None:
    path = tmp_path / name
    save(path)
    assert files.read(path, **options).tobytes() == EVENTS.tobytes()
    assert files.summary(path, **options).events == COUNT


def test_bad_options_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes(text(T, X, Y, P, before="t,x,y,p\n"))
    for options, says in (
        ({"columns": "t,x,y"}, "name t, x, y and p once each"),
        ({"columns": "t,y,x,p"}, "the columns are named t, x, y, p"),
        ({"columns": "t=time,x=x,y=y,p=p"}, "its first line is 't x y p'"),
        ({"unit": "h"}, "--unit is 'h': give one of s, ms, us, ns"),
    ):
        with pytest.raises(EvsError, match=says):
            files.read(path, **options)  # type: ignore[arg-type]
    other = tmp_path / "a.aedat4"
    files.convert(path, other)
    with pytest.raises(EvsError, match="AEDAT4, which needs no --unit: leave it out"):
        files.read(other, unit="ns")


def test_commands_report_what_was_decided(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, target = tmp_path / "a.csv", tmp_path / "b.aedat4"
    path.write_bytes(text(X, Y, P, T))
    assert main(["convert", str(path), str(target)]) == 0
    assert "read as: columns x, y, p, t; times in us\n" in capsys.readouterr().out
    assert files.read(target).tobytes() == EVENTS.tobytes()
    path.write_bytes(text(T * 1000, Y, X, P))
    words = ["--columns", "t,y,x,p", "--unit", "ns"]
    assert main(["info", str(path)]) == 2
    assert "--columns t,y,x,p, or t,x,y,p" in capsys.readouterr().err
    assert main(["info", str(path), *words]) == 0
    assert "read as     columns t,y,x,p\n" in capsys.readouterr().out
    assert main(["convert", str(path), str(target), "--force", *words]) == 0
    assert files.read(target).tobytes() == EVENTS.tobytes()


def test_rows_with_an_unknown_polarity_or_half_a_pixel_are_damaged(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes(text(T, X, Y, P) + b"300000,1,2,3\n300001,1.5,2,1\n")
    with pytest.warns(DamagedPacketWarning, match="2 damaged lines"):
        assert files.read(path).tobytes() == EVENTS.tobytes()


def test_a_small_file_that_states_gigabytes_is_refused_before_it_is_read(tmp_path: Path) -> None:
    zeros = bytes(1 << 20)
    path = tmp_path / "bomb.npz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in "txyp":
            with archive.open(f"{name}.npy", "w") as member:
                header = {"descr": "|u1", "fortran_order": False, "shape": (17 << 20,)}
                np.lib.format.write_array_header_1_0(member, header)
                for _ in range(17):
                    member.write(zeros)
    with pytest.raises(EvsError, match="which cannot be in it"):
        files.read(path)
    path = tmp_path / "bomb.h5"
    with h5py.File(path, "w") as file:
        for name in "txyp":
            one = file.create_dataset(
                f"events/{name}", (17 << 20,), "u1", chunks=(1 << 20,), compression="gzip"
            )
            one[:] = 0
    with pytest.raises(EvsError, match="which cannot be in it"):
        files.read(path)


def test_each_layout_of_the_table_names_four_fields() -> None:
    for layout in layouts.LAYOUTS:
        fields = [column.partition("=")[0] for column in layout.columns if column]
        assert sorted(fields) == sorted(layouts.FIELDS)
