# SPDX-License-Identifier: Apache-2.0
"""The names under `grasptrack`, and what importing it costs."""

import inspect
import re
import subprocess
import sys

import pytest

import grasptrack as gt
from grasptrack import kernels
from grasptrack.kernels import reference


def run(code):
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return done.stdout.strip()


def test_every_public_name_is_there():
    assert [name for name in gt.__all__ if not hasattr(gt, name)] == []
    assert set(gt.__all__) <= set(dir(gt))
    with pytest.raises(AttributeError, match="nonsense"):
        _ = gt.nonsense


@pytest.mark.parametrize(
    "before",
    ["", "import grasptrack.transfer.rrp", "from grasptrack.transfer import Transfer", "grasptrack.transfer"],
)
def test_transfer_is_a_function_whatever_was_imported_before(before):
    code = f"import grasptrack\n{before}\nfrom grasptrack import transfer\nprint(callable(grasptrack.transfer))"
    assert run(code + "\ntry: transfer()\nexcept TypeError as e: print(e)").startswith("True\ntransfer() missing")


def test_each_kernel_has_its_reference():
    names = set(kernels.__all__) - {"BACKEND"}
    assert names == set(reference.__all__)
    assert all(callable(getattr(kernels, name)) for name in names)


def test_compiled_kernels_take_the_arguments_of_their_definitions(native):
    assert {name for name in dir(native) if not name.startswith("_")} == set(reference.__all__)
    for name in set(reference.__all__) - {"PoseTarget"}:
        wanted = list(inspect.signature(getattr(reference, name)).parameters)
        for signature, *_ in getattr(native, name).__nb_signature__:
            assert re.findall(r"(?:\(|, )(\w+): ", signature) == wanted, signature
