# SPDX-License-Identifier: Apache-2.0
"""The names under `grasptrack`, and what importing it costs."""

import inspect
import re
import subprocess
import sys

import pytest

import _grasptrack_native as native
import grasptrack as gt
import reference
from grasptrack import kernels
from write_stub import NUMBERS, STUB, write_stub


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


def test_compiled_kernels_take_the_arguments_of_their_definitions():
    assert {name for name in dir(native) if not name.startswith("_")} == {*reference.__all__, *NUMBERS}
    assert all(getattr(kernels, name) is getattr(native, name) for name in reference.__all__)
    for name in reference.__all__:
        kernel = getattr(native, name)
        if isinstance(kernel, type):
            declared = getattr(reference, name)
            wanted = {n for n in (*vars(declared), *inspect.get_annotations(declared)) if not n.startswith("_")}
            assert wanted == {n for n in vars(kernel) if not n.startswith("_")}
            continue
        wanted = list(inspect.signature(getattr(reference, name)).parameters)
        for signature, *_ in kernel.__nb_signature__:
            assert re.findall(r"(?:\(|, )(\w+): ", signature) == wanted, signature


def test_the_stub_is_what_the_definitions_say():
    pytest.importorskip("ruff")
    assert write_stub() == STUB.read_text(encoding="utf-8")


@pytest.mark.parametrize("module", ["grasptrack", "grasptrack.cli.main"])
def test_without_its_kernels_importing_says_what_to_do(module):
    # A module that is None in sys.modules cannot be imported: what a build without a compiler looks like.
    code = f"import sys; sys.modules['_grasptrack_native'] = None; import {module}"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    last = done.stderr.splitlines()[-1]
    assert last.startswith("ImportError: grasptrack's compiled kernels cannot be loaded") and "C++17 compiler" in last
