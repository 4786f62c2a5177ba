# SPDX-License-Identifier: Apache-2.0
"""`grasptrack servo` as a whole: one approach with all its files, and the risk that it takes."""

import json
from pathlib import Path

import pytest

from grasptrack.cli.main import main

pytest.importorskip("mujoco", reason="the physical world needs MuJoCo")


def test_one_approach_writes_video_plots_and_a_verdict(tmp_path: Path) -> None:
    assert (
        main(["servo", "--shape", "rectangle", "--seed", "1", "--images", "planar", "-q", "--output", str(tmp_path)])
        == 0
    )
    verdict = json.loads((tmp_path / "approach.json").read_text())["verdict"]
    assert verdict["outcome"] in ("lifted", "failed", "refused")
    assert verdict["believed"] is not False
    assert (tmp_path / "approach.mp4").stat().st_size > 10_000
    assert (tmp_path / "approach.png").stat().st_size > 10_000


def test_the_risk_decides_whether_the_hand_closes(tmp_path: Path) -> None:
    found = {}
    for risk in (1e-12, 1e-3):
        given = ["--shape", "guitar", "--seed", "7", "--images", "planar", "--no-video", "-q", "--risk", str(risk)]
        assert main(["servo", *given, "--output", str(tmp_path)]) == 0
        told = json.loads((tmp_path / "approach.json").read_text())
        assert told["options"]["risk"] == risk
        found[risk] = told["verdict"]
    assert found[1e-3]["outcome"] == "lifted" and found[1e-3]["believed"]
    assert found[1e-12]["outcome"] == "failed" and found[1e-12]["believed"] is None  # nothing is so sure
