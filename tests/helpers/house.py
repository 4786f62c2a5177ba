# SPDX-License-Identifier: Apache-2.0
"""The laws of the tree, as functions of its source: who imports whom, what is named twice, how long things are."""

import ast
from collections import defaultdict
from dataclasses import dataclass
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[2]
PACKAGES = {
    "grasptrack": ROOT / "src" / "grasptrack",
    "grasptrack_bench": ROOT / "bench" / "grasptrack_bench",
    "research": ROOT / "research",
}


@dataclass(frozen=True)
class Module:
    """A module of the tree, by its dotted name."""

    name: str
    path: Path
    tree: ast.Module
    lines: int


@cache
def modules() -> dict[str, Module]:
    """All modules of the wheel, the bench and the research, by name."""
    found = {}
    for package, folder in PACKAGES.items():
        for path in sorted(folder.rglob("*.py")):
            parts = [package, *path.relative_to(folder).with_suffix("").parts]
            name = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
            text = path.read_text()
            found[name] = Module(name, path, ast.parse(text), text.count("\n"))
    return found


def imported(module: Module) -> set[str]:
    """Modules of the tree that one imports where it is loaded or typed, and within functions."""
    package = module.name if module.path.name == "__init__.py" else module.name.rpartition(".")[0]
    found: set[str] = set()
    for node in ast.walk(module.tree):
        if isinstance(node, ast.Import):
            found.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = package.rsplit(".", node.level - 1)[0] if node.level else ""
            origin = ".".join(filter(None, [base, node.module or ""]))
            for alias in node.names:
                inner = f"{origin}.{alias.name}"
                found.add(inner if inner in modules() else origin)
    return {name for name in found if name.partition(".")[0] in PACKAGES} - {module.name}


def circles(edges: dict[str, set[str]]) -> list[list[str]]:
    """Groups of modules that import each other, directly or by way of others (Tarjan's strongly connected components)."""
    index: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    found: list[list[str]] = []

    def visit(name: str) -> None:
        index[name] = low[name] = len(index)
        stack.append(name)
        for other in edges.get(name, ()):
            if other not in index:
                visit(other)
                low[name] = min(low[name], low[other])
            elif other in stack:
                low[name] = min(low[name], index[other])
        if low[name] == index[name]:
            group = stack[stack.index(name) :]
            del stack[stack.index(name) :]
            if len(group) > 1:
                found.append(sorted(group))

    for name in edges:
        if name not in index:
            visit(name)
    return found


def functions(module: Module) -> list[ast.FunctionDef | ast.AsyncFunctionDef]:
    """Every function and method of a module but those that Python names."""
    nodes = [node for node in ast.walk(module.tree) if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)]
    return [node for node in nodes if not node.name.startswith("__")]


def parameter_count(function: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    """Parameters that a caller may give: neither self and cls nor * and **."""
    given = [argument.arg for argument in (*function.args.posonlyargs, *function.args.args, *function.args.kwonlyargs)]
    return len(given) - (given[:1] in (["self"], ["cls"]))


def classes() -> dict[str, list[str]]:
    """The modules that define a class of each name."""
    found = defaultdict(list)
    for module in modules().values():
        for node in ast.walk(module.tree):
            if isinstance(node, ast.ClassDef):
                found[node.name].append(module.name)
    return found


def nameless_floats(module: Module) -> list[tuple[int, float]]:
    """Line and value of each decimal number within a function of a module that carries no name."""
    plain = {0.0, 0.5, 1.0, 2.0}
    found = []
    for function in functions(module):
        defaults = {
            id(node)
            for default in (*function.args.defaults, *filter(None, function.args.kw_defaults))
            for node in ast.walk(default)
        }
        found += [
            (node.lineno, node.value)
            for node in ast.walk(function)
            if isinstance(node, ast.Constant)
            and isinstance(node.value, float)
            and node.value not in plain
            and not 0 < abs(node.value) < 1e-5  # a numerical tolerance
            and id(node) not in defaults
        ]
    return sorted(set(found))
