"""No module of the package imports itself, however long the way round."""

from __future__ import annotations

import ast
from collections.abc import Iterator, Mapping
from pathlib import Path

import pytest


def module_name(path: str) -> str:
    """The dotted name of a source file; a package's __init__.py bears the package's."""
    name = path.removesuffix("i").removesuffix(".py").removesuffix("/__init__").replace("/", ".")
    return f"evs_{name}" if name.split(".")[0] == "lab" else f"evs.{name}"


def imports_at_module_level(tree: ast.Module) -> Iterator[ast.Import | ast.ImportFrom]:
    """Import statements that run with the module or that type checkers follow (TYPE_CHECKING).

    Those within functions are left out: they run later.
    """
    waiting: list[ast.AST] = list(tree.body)
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.Import | ast.ImportFrom):
            yield node
        elif not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
            waiting.extend(ast.iter_child_nodes(node))


def import_graph(sources: Mapping[str, ast.Module]) -> dict[str, set[str]]:
    """Module -> modules of the package that it imports by name.

    An import from a package (`from evs.msgs import Events`) is one of its __init__.py. That a
    module's own packages run before it is no import: it takes nothing from them.
    """
    modules = {module_name(path): tree for path, tree in sources.items()}
    graph: dict[str, set[str]] = {name: set() for name in modules}
    for name, tree in modules.items():
        for node in imports_at_module_level(tree):
            if isinstance(node, ast.Import):
                targets = [alias.name for alias in node.names]
            else:
                module = f"{name}.{node.module}" if node.level else node.module
                inner = [f"{module}.{alias.name}" for alias in node.names]
                # the compiled core has no source here
                inner = [target for target in inner if not target.endswith("._core")]
                targets = [t if t in modules else str(module) for t in inner]
            graph[name].update(target for target in targets if target in modules)
    return graph


def circles(graph: Mapping[str, set[str]]) -> list[list[str]]:
    """The sets of modules that reach each other, each sorted (Tarjan's strong components)."""
    order: dict[str, int] = {}
    lowest: dict[str, int] = {}
    stack: list[str] = []
    found = []

    def visit(name: str) -> None:
        order[name] = lowest[name] = len(order)
        stack.append(name)
        for target in sorted(graph[name]):
            if target not in order:
                visit(target)
                lowest[name] = min(lowest[name], lowest[target])
            elif target in stack:
                lowest[name] = min(lowest[name], order[target])
        if lowest[name] == order[name]:
            component = stack[stack.index(name) :]
            del stack[stack.index(name) :]
            if len(component) > 1 or name in graph[name]:
                found.append(sorted(component))

    for name in sorted(graph):
        if name not in order:
            visit(name)
    return found


def test_no_modules_import_each_other_in_a_circle(
    checkout: Path, sources: dict[str, ast.Module]
) -> None:
    stubs = {f"{name}i" for name in sources if (checkout / f"{name}i").is_file()}
    assert "msgs/__init__.pyi" in stubs
    read = {name: ast.parse((checkout / name).read_text()) for name in stubs}
    assert circles(import_graph({**sources, **read})) == []


@pytest.mark.parametrize(
    ("sources", "expected"),
    [
        ({"msgs/a.py": "import evs.msgs.b", "msgs/b.py": "from evs.msgs.a import x"}, ["a", "b"]),
        (
            {"msgs/a.py": "from evs.msgs import b", "msgs/b.py": "from evs.msgs import a"},
            ["a", "b"],
        ),
        ({"msgs/a.py": "from evs.msgs.a import x"}, ["a"]),
        (
            {
                "msgs/a.py": "if TYPE_CHECKING:\n    from evs.msgs.b import x",
                "msgs/b.py": "try:\n    import evs.msgs.c\nexcept ImportError:\n    pass",
                "msgs/c.py": "from evs.msgs.a import y",
            },
            ["a", "b", "c"],
        ),
    ],
)
def test_a_circle_is_found(sources: dict[str, str], expected: list[str]) -> None:
    trees = {path: ast.parse(text) for path, text in sources.items()}
    assert circles(import_graph(trees)) == [[f"evs.msgs.{name}" for name in expected]]


def test_a_package_that_exports_what_imports_it_is_a_circle() -> None:
    trees = {
        "msgs/__init__.py": ast.parse("from evs.msgs.a import x"),
        "msgs/a.py": ast.parse("from evs.msgs import y"),
    }
    assert circles(import_graph(trees)) == [["evs.msgs", "evs.msgs.a"]]


@pytest.mark.parametrize(
    "sources",
    [
        {"msgs/a.py": "import evs.msgs.b", "msgs/b.py": "def f():\n    import evs.msgs.a"},
        {"msgs/__init__.py": "from evs.msgs.a import x", "msgs/a.py": "from evs.msgs.b import y"},
        {"msgs/a.py": "from evs.msgs import _core", "msgs/__init__.py": "import evs.msgs.a"},
        {"msgs/a.py": "TABLE = {'b': 'evs.msgs.b:B'}", "msgs/b.py": "import evs.msgs.a"},
    ],
)
def test_what_is_no_circle_passes(sources: dict[str, str]) -> None:
    trees = {path: ast.parse(text) for path, text in sources.items()}
    assert circles(import_graph(trees)) == []
