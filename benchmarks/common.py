# SPDX-License-Identifier: Apache-2.0
"""What the benchmarks share: one thread, the clock, the machine, tables, the file of results. Import it before NumPy."""

from __future__ import annotations

import os

os.environ["OMP_NUM_THREADS"] = "1"
os.environ["OPENBLAS_NUM_THREADS"] = "1"
os.environ["MKL_NUM_THREADS"] = "1"

import argparse
import gc
import platform
import re
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import cv2
import numpy as np

cv2.setNumThreads(1)

PREFACE = """# Results of the benchmarks

Written by the scripts themselves, each its own section with the command above it: `python benchmarks/NAME.py --output
benchmarks/RESULTS.md`. How to read them is in [docs/benchmarks.md](../docs/benchmarks.md)."""


def machine() -> str:
    """One line that says what the figures were measured on."""
    from grasptrack import kernels
    from grasptrack.io.results import describe_machine as processor

    return (
        f"{processor()}, one thread; Python {platform.python_version()}, "
        f"NumPy {np.__version__}, OpenCV {cv2.__version__}, kernels: {kernels.BACKEND}"
    )


_sections: list[tuple[str, list[str]]] = []  # title and paragraphs of what was shown so far


def parser(description: str | None) -> argparse.ArgumentParser:
    """Options of a script, with the one that they all have."""
    made = argparse.ArgumentParser(description=description)
    made.add_argument("--output", type=Path, help="Markdown file in which the sections of this script are written anew")
    return made


def heading(title: str) -> None:
    """Title, machine, and the command that repeats the run: a section begins."""
    command = f"python {' '.join([*_script(), *sys.argv[1:]])}"
    print(f"\n{title}\n{machine()}\n$ {command}\n")
    _sections.append((title, [f"`{command}`", f"{machine()}."]))


def _script() -> list[str]:
    path = Path(sys.argv[0]).resolve()
    return [str(path.relative_to(Path.cwd())) if path.is_relative_to(Path.cwd()) else sys.argv[0]]


def say(text: str) -> None:
    """A sentence above or below a table."""
    print(text)
    _note(text)


def table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """A plain table; figures to the right, words to the left."""
    listed = [[_cell(c) for c in row] for row in rows]
    widths = [max(len(r[i]) for r in [list(head), *listed]) for i in range(len(head))]
    number = [all(_is_number(r[i]) for r in listed) for i in range(len(head))]
    for k, row in enumerate([list(head), *listed]):
        print("  ".join(c.rjust(w) if n else c.ljust(w) for c, w, n in zip(row, widths, number, strict=True)).rstrip())
        if k == 0:
            print("  ".join("-" * w for w in widths))
    print()
    rule = ["---:" if n else "---" for n in number]
    _note("\n".join(f"| {' | '.join(row)} |" for row in [list(head), rule, *listed]))


def _note(paragraph: str) -> None:
    if _sections:
        _sections[-1][1].append(paragraph)


def finish(path: Path | None) -> None:
    """Write all sections of this run to a file of results, in the place of those with the same titles."""
    if path is not None:
        for title, paragraphs in _sections:
            section(path, title, "\n\n".join(paragraphs))


def section(path: Path, title: str, text: str) -> None:
    """Put a section into a Markdown file: where the one with this title is, else at the end.

    Args:
        path: of the file, made when missing.
        title: of the section, without its mark.
        text: all of it but the title.
    """
    whole = path.read_text(encoding="utf-8") if path.exists() else PREFACE
    before, *parts = re.split(r"^## ", whole, flags=re.MULTILINE)
    sections = {part.partition("\n")[0]: part.partition("\n")[2].strip() for part in parts}
    sections[title] = text.strip()
    body = "".join(f"\n\n## {name}\n\n{content}" for name, content in sections.items())
    path.write_text(f"{before.strip()}{body}\n", encoding="utf-8")


def _cell(value: object) -> str:
    """Three digits, and no powers of ten in a range where a person would write none."""
    if not isinstance(value, float):
        return str(value)
    if np.isnan(value):
        return ""
    return f"{value:,.0f}" if 100.0 <= abs(value) < 1e7 else f"{value:.3g}"


def _is_number(cell: str) -> bool:
    return not cell or cell[0] in "-+.0123456789"


def each(call: Callable[..., object], pool: Iterable[tuple[object, ...]]) -> np.ndarray:
    """(n,) s of a call over a pool of arguments, each used once, the collector at rest."""
    clock = time.perf_counter_ns
    taken = []
    gc.collect()
    gc.disable()
    try:
        for arguments in pool:
            start = clock()
            call(*arguments)
            taken.append(clock() - start)
    finally:
        gc.enable()
    return 1e-9 * np.array(taken)


def percentiles(seconds: Sequence[float]) -> tuple[float, float]:
    """Median and 99th percentile in ms."""
    return float(np.percentile(seconds, 50)) * 1e3, float(np.percentile(seconds, 99)) * 1e3
