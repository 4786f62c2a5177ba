# SPDX-License-Identifier: Apache-2.0
"""The archive of the paper's rerun: a scorer that needs NumPy alone comes to the tables that research.paper prints."""

import ast
import csv
import json
import shutil
import subprocess
import sys
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from research.archive import score
from research.archive.__main__ import main
from research.paper.footage import MOTIONS

FRAMES = 5
SCORER = Path(score.__file__)


@pytest.fixture(scope="module")
def archive(tmp_path_factory):
    folder = tmp_path_factory.mktemp("archive")
    main(["--frames", str(FRAMES), "--output", str(folder)])
    return folder


def test_tables_i_to_vii_are_worked_out_anew(archive):
    found = score.score(archive)
    sixes, sevens = [f"VI-{k}" for k in range(1, 4)], [f"VII-{k}" for k in range(1, 12)]
    assert (
        set(found) == {"I", "II", "III", "IV", "V", *sixes, *sevens} == {p.stem for p in archive.glob("tables/*.csv")}
    )
    assert max(found.values()) < score.TOLERANCE
    done = subprocess.run([sys.executable, "score.py"], cwd=archive, capture_output=True, text=True, check=True)
    assert done.stdout.count("Table ") == len(found)


def test_the_scorer_is_short_and_needs_numpy_alone():
    text = SCORER.read_text(encoding="utf-8")
    assert text.count("\n") <= 200
    nodes = list(ast.walk(ast.parse(text)))
    needed = {n.module for n in nodes if isinstance(n, ast.ImportFrom)}
    needed |= {alias.name for n in nodes if isinstance(n, ast.Import) for alias in n.names}
    assert {name.split(".")[0] for name in needed} - sys.stdlib_module_names == {"numpy"}


def test_truths_are_the_given_grasps_through_the_homographies_and_areas_those_of_the_object(archive):
    rows = score.read(archive / "transfers.csv")
    given = {tuple(r[c] for c in KEY): score.contacts_of(r, "true_") for r in rows if r["way"] == "there and back"}
    for r in rows:
        name = "-".join((r["object"], r["contours"], r["motion"])).replace(" ", "-")
        k = int(r["frame"]) if r["way"] != "there and back" else 0
        H = load(archive, f"{name}-homographies")[k, 1:].reshape(3, 3)
        np.testing.assert_allclose(
            score.contacts_of(r, "true_"), score.moved(H, given[tuple(r[c] for c in KEY)]), atol=1e-9
        )
        outline = load(
            archive, f"{r['object']}-{'exact' if r['contours'] == 'rendered' else 'resampled-4-DoF-extracted'}"
        )
        shape = [outline[(outline[:, :2] == (0, c)).all(1), 2:] @ (1, 1j) for c in np.unique(outline[:, 1])]
        area = score.integral([score.moved(H, c) for c in shape], lambda z: z.real * 0 + 1, 0)
        assert area == pytest.approx(float(r["area_px2"]), rel=1e-9)


KEY = ("object", "contours", "motion", "strategy")


@cache
def load(archive, name):
    return np.loadtxt(archive / "contours" / f"{name}.csv", delimiter=",", skiprows=1)


@pytest.mark.parametrize(
    ("file", "column", "tables"),
    [
        ("transfers.csv", "x1", {"VI-1"}),
        ("descriptions.csv", "y1", {"I"}),
        ("correspondences.csv", "sample", {"II", "V"}),
    ],
)
def test_another_number_makes_other_tables(archive, tmp_path, file, column, tables):
    changed = shutil.copytree(archive, tmp_path / "changed")
    rows = score.read(changed / file)
    rows[0][column] = str(float(rows[0][column]) + 1.0).removesuffix(".0")
    with (changed / file).open("w", newline="", encoding="utf-8") as out:
        writer = csv.DictWriter(out, rows[0])
        writer.writeheader()
        writer.writerows(rows)
    assert {number for number, worst in score.score(changed).items() if worst > score.TOLERANCE} == tables


def test_the_readme_says_what_every_column_is_and_the_deposit_can_be_made(archive):
    readme = (archive / "README.md").read_text(encoding="utf-8")
    for name in ("transfers", "descriptions", "correspondences"):
        described = next(line for line in readme.splitlines() if line.startswith(f"| `{name}.csv`"))
        for column in score.read(archive / f"{name}.csv")[0]:
            assert f"`{column}`" in described or column[-2:] in ("x2", "y1", "y2") or column.endswith("x1"), column
    for motion in MOTIONS:
        assert f"*{motion}*" in readme
    deposit = json.loads((archive / ".zenodo.json").read_text(encoding="utf-8"))
    assert {"title", "upload_type", "description", "creators", "license", "version"} <= set(deposit)


def test_too_few_frames_are_refused(capsys):
    with pytest.raises(SystemExit):
        main(["--frames", "3"])
    assert "at least 4 frames are needed, not 3" in capsys.readouterr().err
