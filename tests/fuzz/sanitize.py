# SPDX-License-Identifier: Apache-2.0
"""Build the kernels with AddressSanitizer and UndefinedBehaviorSanitizer, then run their tests and some of the fuzzer.

Where Python loads such a module the sanitizer has to be there first (LD_PRELOAD), and the C++ library with it, whose exceptions
it watches. Its own search for leaks is off, as the interpreter keeps what it frees only at its end: `leaks.py` counts bytes.
"""

import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
BUILD = ROOT / "build" / "sanitize"
LAWS = sorted(str(path) for path in (ROOT / "tests" / "laws").glob("test_kernels_*.py"))
HOOK = """\
import importlib.util, pathlib, sys
path = next(pathlib.Path(__file__).parent.glob("_grasptrack_native*"))
spec = importlib.util.spec_from_file_location("_grasptrack_native", path)
module = sys.modules["_grasptrack_native"] = importlib.util.module_from_spec(spec)
spec.loader.exec_module(module)
"""
"""Of the `sitecustomize` beside the module: an editable install would find its own module first."""


def build() -> None:
    """Configure and compile in `build/sanitize`."""
    options = {
        "CMAKE_BUILD_TYPE": "Release",
        "GRASPTRACK_SANITIZE": "ON",
        "Python_EXECUTABLE": sys.executable,
        "nanobind_DIR": nanobind_folder(),
    }
    subprocess.run(["cmake", "-S", ROOT, "-B", BUILD, *(f"-D{k}={v}" for k, v in options.items())], check=True)
    subprocess.run(["cmake", "--build", BUILD, "--parallel", str(os.cpu_count() or 1)], check=True)
    (BUILD / "sitecustomize.py").write_text(HOOK, encoding="utf-8")


def nanobind_folder() -> str:
    """Where CMake finds nanobind, which an install of the package needs only while it builds."""
    try:
        import nanobind
    except ModuleNotFoundError:
        sys.exit("make sanitize needs nanobind: pip install nanobind")
    return str(nanobind.cmake_dir())


def library(name: str) -> str:
    """Path of a library of the compiler."""
    asked = [os.environ.get("CXX", "g++"), f"-print-file-name={name}"]
    return subprocess.run(asked, check=True, capture_output=True, text=True).stdout.strip()


def run(*command: str) -> int:
    """A command of this Python's under the sanitizers; its status."""
    environment = {
        **os.environ,
        "LD_PRELOAD": f"{library('libasan.so')} {library('libstdc++.so')}",
        "PYTHONPATH": str(BUILD),
        "ASAN_OPTIONS": "detect_leaks=0:allocator_may_return_null=1",
        "UBSAN_OPTIONS": "print_stacktrace=1",
    }
    return subprocess.run([sys.executable, *command], env=environment, cwd=ROOT, check=False).returncode


def main() -> int:
    """Status 1 where anything was found."""
    build()
    loaded = "import _grasptrack_native as n; assert 'sanitize' in n.__file__, n.__file__"
    fuzz = ["-W", "ignore", "tests/fuzz/run.py", "--calls", "8000", "--contours", "1500", "--patience", "120"]
    if run("-c", loaded):
        return 1
    laws = ["-m", "pytest", "-p", "no:xdist", "-m", "not slow", *LAWS]
    with ThreadPoolExecutor() as side_by_side:
        return int(any(side_by_side.map(lambda command: run(*command), (laws, fuzz))))


if __name__ == "__main__":
    sys.exit(main())
