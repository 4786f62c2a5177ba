# SPDX-License-Identifier: Apache-2.0
"""The notebooks run as they stand, and none is committed with its output."""

from pathlib import Path

import pytest

NOTEBOOKS = sorted((Path(__file__).resolve().parents[2] / "examples" / "notebooks").glob("*.ipynb"))


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebooks_run(notebook: Path) -> None:
    nbclient = pytest.importorskip("nbclient")
    nbformat = pytest.importorskip("nbformat")
    pytest.importorskip("ipykernel")
    content = nbformat.read(notebook, as_version=4)
    assert not any(cell.get("outputs") for cell in content.cells)
    client = nbclient.NotebookClient(content, timeout=120, resources={"metadata": {"path": notebook.parent}})
    done = client.execute()
    shown = [out.get("data", {}) for cell in done.cells for out in cell.get("outputs", [])]
    assert sum("image/png" in data for data in shown) >= 1


def test_there_are_four() -> None:
    assert len(NOTEBOOKS) == 4
