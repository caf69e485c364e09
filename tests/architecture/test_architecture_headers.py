"""Each header and .inl of the native core is guarded and opens alone; none includes itself."""

from __future__ import annotations

import itertools
import os
import re
import shutil
import subprocess
import sys
import sysconfig
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

FIRST = re.compile(r'^\s*#\s*include\s*["<]([^">]+)', re.M)
INCLUDE = re.compile(r'^\s*#include "([^"]+)"', re.M)


@pytest.fixture(scope="module")
def core(checkout: Path) -> Path:
    """The folder of the native core."""
    return checkout / "emulator/core"


@pytest.fixture(scope="module")
def headers(core: Path, files: list[str]) -> list[str]:
    """Every header and .inl, from the core's folder."""
    prefix = "emulator/core/"
    return [
        name.removeprefix(prefix)
        for name in files
        if name.startswith(prefix) and name.endswith((".h", ".inl"))
    ]


@pytest.fixture(scope="module")
def includes(core: Path, headers: list[str]) -> dict[str, list[str]]:
    """Which of the core's headers each of them includes."""
    return {header: INCLUDE.findall((core / header).read_text()) for header in headers}


def test_every_header_is_included_by_its_full_path(
    checkout: Path, core: Path, headers: list[str]
) -> None:
    folders = (core, checkout / "tests/emulator/core")
    ends = ("h", "inl", "cpp", "cu", "cuh")
    sources = [path for folder in folders for end in ends for path in folder.rglob(f"*.{end}")]
    assert len(sources) > len(headers)
    named = {name for path in sources for name in INCLUDE.findall(path.read_text())}
    assert [
        name
        for name in sorted(named)
        if not any((folder / name).is_file() for folder in (core, checkout))
    ] == []


def test_no_two_headers_have_one_name(headers: list[str]) -> None:
    names = sorted(Path(header).name for header in headers)
    assert [name for name, after in itertools.pairwise(names) if name == after] == []


def test_every_header_is_guarded(core: Path, headers: list[str]) -> None:
    guard = re.compile(r"^#pragma once$|^#ifndef (\w+)\n#define \1$", re.M)
    assert len(headers) > 50
    assert [name for name in headers if not guard.search((core / name).read_text())] == []


def circle(includes: dict[str, list[str]]) -> list[str]:
    """Headers that include each other in a circle, in order; empty where there is none."""
    done: set[str] = set()

    def walk(header: str, above: list[str]) -> list[str]:
        if header in above:
            return above[above.index(header) :]
        if header in done:
            return []
        for below in includes[header]:
            if around := walk(below, [*above, header]):
                return around
        done.add(header)
        return []

    return next((around for header in includes if (around := walk(header, []))), [])


def test_no_headers_include_each_other_in_a_circle(includes: dict[str, list[str]]) -> None:
    assert sum(map(len, includes.values())) > 100
    assert circle(includes) == []


def test_a_circle_is_found() -> None:
    assert circle({"a": ["b", "c"], "b": [], "c": ["d"], "d": ["c"]}) == ["c", "d"]


@pytest.mark.slow
def test_every_header_compiles_alone(checkout: Path, core: Path, headers: list[str]) -> None:
    compiler = os.environ.get("CXX") or shutil.which("c++") or shutil.which("g++")
    if not compiler:
        pytest.skip("no C++ compiler")
    # what another file includes before all else is compiled alone there
    first = set()
    for path in core.rglob("*"):
        if path.suffix in (".cpp", ".h", ".inl") and (found := FIRST.search(path.read_text())):
            first.add(found[1])
    rest = [header for header in headers if header not in first]
    assert len(rest) > 50
    # where .ci/headers.sh unpacks Python.h if the system has none
    unpacked = checkout / "build/headers/usr/include"
    python = sysconfig.get_path("include")
    nanobind = subprocess.run(
        [sys.executable, "-m", "nanobind", "--include_dir"],
        capture_output=True,
        text=True,
        check=True,
    ).stdout.strip()
    system = [nanobind, python, str(unpacked), str(unpacked / Path(python).name)]
    flags = [f"-I{core}", *(f"-isystem{path}" for path in system)]

    def complaint(header: str) -> str:
        result = subprocess.run(
            [compiler, "-std=c++20", "-fsyntax-only", *flags, "-x", "c++", "-"],
            input=f'#include "{core / header}"\n',
            capture_output=True,
            text=True,
            check=False,
        )
        return f"{header}: {result.stderr}" if result.returncode else ""

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        assert [text for text in pool.map(complaint, rest) if text] == []
