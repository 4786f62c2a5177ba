# SPDX-License-Identifier: Apache-2.0
"""The names under `grasptrack`, and what importing it costs."""

import inspect
import re
import runpy
import subprocess
import sys
from pathlib import Path

import pytest

import _grasptrack_native as native
import grasptrack as gt
import reference
from grasptrack import kernels
from scene import CLASS, METHODS, parameters_of

STUB = Path(__file__).resolve().parents[2] / "src" / "_grasptrack_native.pyi"


def run(code):
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return done.stdout.strip()


def test_every_public_name_is_there():
    assert [name for name in gt.__all__ if not hasattr(gt, name)] == []
    assert set(gt.__all__) <= set(dir(gt))
    with pytest.raises(AttributeError, match="nonsense"):
        _ = gt.nonsense


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    "before", ["", "import grasptrack.transfer.rrp", "from grasptrack.transfer import Transfer", "grasptrack.transfer"]
)
def test_transfer_is_a_function_whatever_was_imported_before(before):
    code = f"import grasptrack\n{before}\nfrom grasptrack import transfer\nprint(callable(grasptrack.transfer))"
    assert run(code + "\ntry: transfer()\nexcept TypeError as e: print(e)").startswith("True\ntransfer() missing")


def test_kernels_their_definitions_and_the_stub_take_and_give_the_same():
    stub = runpy.run_path(str(STUB))
    declared = {name for name in (*stub, *stub["__annotations__"]) if hasattr(native, name) and name[0] != "_"}
    assert declared == {name for name in dir(native) if name[0] != "_"}
    for name in reference.__all__:
        assert getattr(kernels, name) is getattr(native, name)
        told = inspect.signature(stub[name])
        assert told == inspect.signature(getattr(reference, name)), name
        for signature, *_ in getattr(native, name).__nb_signature__:
            assert re.findall(r"(?:\(|, )(\w+): ", signature) == list(told.parameters), signature
    for kind in (native.PoseTarget, native.PoseEstimate, native.PoseFlow):
        names = {*vars(stub[kind.__name__]), *inspect.get_annotations(stub[kind.__name__])}
        assert {n for n in names if n[0] != "_"} == {n for n in vars(kind) if n[0] != "_"}
    for method in (*METHODS, "__init__"):
        assert ["self", *parameters_of(f"{CLASS}.{method}")] == list(
            inspect.signature(getattr(stub[CLASS], method)).parameters
        )


@pytest.mark.parametrize("module", ["grasptrack", "grasptrack.cli.main"])
def test_without_its_kernels_importing_says_what_to_do(module):
    # A module that is None in sys.modules cannot be imported: what a build without a compiler looks like.
    code = f"import sys; sys.modules['_grasptrack_native'] = None; import {module}"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    last = done.stderr.splitlines()[-1]
    assert last.startswith("ImportError: grasptrack's compiled kernels cannot be loaded") and "C++17 compiler" in last
