# SPDX-License-Identifier: Apache-2.0
"""The stub of the compiled module, written from the definitions in `reference`: signatures, types and docstrings.

    python tests/oracle/write_stub.py    writes src/_grasptrack_native.pyi

Names that the definitions' modules have for types are replaced by what they stand for.
"""

import ast
import builtins
import importlib
import subprocess
import sys
from functools import cache
from pathlib import Path

import _grasptrack_native as native
import reference

STUB = Path(__file__).resolve().parents[2] / "src" / "_grasptrack_native.pyi"
NUMBERS = {
    "EDGE_WINDOW": "px on either side of an edge whose gradients tell its place (`search_along_normals`).",
    "POSE_NUMBERS": "Of `grasptrack.tracking.numbers.Numbers`, those that `PoseTarget` needs.",
    "PATCH_SIDE": "Pixels of the side of a patch of texture (`PoseTarget.add_texture`).",
    "FINE_LEVELS": "Levels of texture, from the finest, that are used beside the edges.",
    "REGION_CELLS": "Depths on each side of the outline at which grey levels are compared.",
    "FIRST_CELLS": "Of those, beside the outline, tell the levels here, and whether a side is as it was.",
    "NEAR_SAMPLES": "Seen samples on each side of a stretch that is not seen that count for the levels there.",
    "LEAST_SPREAD": "Grey levels that are added to any spread.",
    "LEAST_HALF_WIDTH": "Work px on each side of an edge that are averaged, at least.",
    "MOST_HALF_WIDTH": "The same at most.",
}
"""What the compiled module says beside its kernels."""
HEAD = f'''# SPDX-License-Identifier: Apache-2.0
# Written by tests/oracle/write_stub.py from the definitions in tests/oracle/reference: change those, then run it.
"""The compiled kernels: what each takes, gives and refuses.

{reference.__doc__.partition("Throughout")[1]}{reference.__doc__.partition("Throughout")[2].strip()}
"""
'''


def write_stub() -> str:
    """The text of the stub."""
    kernels = [_definition(name) for name in reference.__all__]
    imports = {"from typing import Final"}
    for module, node in kernels:
        _Types(module, imports).visit(node)
    kinds = {name: type(getattr(native, name)).__name__.replace("tuple", "tuple[str, ...]") for name in NUMBERS}
    numbers = [f'{name}: Final[{kinds[name]}]\n"""{said}"""' for name, said in NUMBERS.items()]
    stubs = [ast.unparse(node) for _, node in kernels]
    parts = [HEAD, *sorted(imports), "_build: str", *numbers, *stubs]
    return _ruff("format", _ruff("check", "\n".join(parts) + "\n", "--quiet", "--select=I", "--fix"))


Kernel = ast.FunctionDef | ast.ClassDef


def _definition(kernel: str) -> tuple[str, Kernel]:
    """The module of a kernel's definition, and what stands there, without bodies."""
    module = getattr(reference, kernel).__module__
    found = [n for n in _tree(module).body if isinstance(n, Kernel) and n.name == kernel]
    return module, _without_body(found[0])


@cache
def _tree(module: str) -> ast.Module:
    return ast.parse(Path(str(importlib.import_module(module).__file__)).read_text(encoding="utf-8"))


def _without_body(kernel: Kernel) -> Kernel:
    said = kernel.body[:1] if ast.get_docstring(kernel) else []
    methods = [n for n in kernel.body if isinstance(n, ast.FunctionDef) and (n.name == "__init__" or n.name[0] != "_")]
    if isinstance(kernel, ast.ClassDef):
        fields = [n for n in kernel.body if isinstance(n, ast.AnnAssign)]
        kernel.body = [*said, *fields, *(_without_body(method) for method in methods)]
    else:
        kernel.body = said or [ast.Expr(ast.Constant(...))]
    return kernel


class _Types(ast.NodeTransformer):
    """Replaces what a module has its own name for in types, and adds what they need to the imports."""

    def __init__(self, module: str, imports: set[str]) -> None:
        self._module, self._imports = module, imports

    def visit_AnnAssign(self, node: ast.AnnAssign) -> ast.AST:
        node.annotation = self.visit(node.annotation)  # the name is the field's own
        return node

    def visit_Name(self, node: ast.Name) -> ast.AST:
        for line in [] if hasattr(builtins, node.id) else _tree(self._module).body:
            if isinstance(line, ast.ImportFrom | ast.Import):
                for alias in line.names:
                    if (alias.asname or alias.name) == node.id:
                        alone = ast.Import([alias]) if isinstance(line, ast.Import) else None
                        self._imports.add(ast.unparse(alone or ast.ImportFrom(line.module, [alias], 0)))
            elif isinstance(line, ast.Assign) and ast.unparse(line.targets) == node.id:
                return self.visit(line.value)
        return node


def _ruff(verb: str, text: str, *options: str) -> str:
    command = [sys.executable, "-m", "ruff", verb, *options, "--stdin-filename", str(STUB), "-"]
    return subprocess.run(command, input=text, capture_output=True, text=True, check=True, encoding="utf-8").stdout


if __name__ == "__main__":
    STUB.write_text(write_stub(), encoding="utf-8")
