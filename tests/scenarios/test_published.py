# SPDX-License-Identifier: Apache-2.0
"""`--publish` of whole runs: what a client reads is what the run writes, and no client changes the run."""

import csv
import json
import socket
import threading
import time
from pathlib import Path
from typing import Any

import pytest

from grasptrack.cli.main import main
from recordings import plates

PATIENCE = 30.0


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        return int(taken.getsockname()[1])


class Client(threading.Thread):
    """Connects as soon as somebody listens, and reads until the end, or a few bytes and then nothing."""

    def __init__(self, port: int, most: int | None = None) -> None:
        super().__init__(daemon=True)
        self._port, self._most = port, most
        self.text = b""
        self.start()

    def run(self) -> None:
        until = time.monotonic() + PATIENCE
        while time.monotonic() < until:
            try:
                link = socket.create_connection(("127.0.0.1", self._port), PATIENCE)
            except OSError:
                time.sleep(0.002)
                continue
            with link, link.makefile("rb") as file:
                self.text = file.read() if self._most is None else file.read(self._most)
                if self._most is not None:
                    time.sleep(1.0)
            return

    def lines(self) -> list[dict[str, Any]]:
        self.join(PATIENCE)
        return [json.loads(line) for line in self.text.splitlines()]


def rows_of(folder: Path) -> list[dict[str, str]]:
    with (folder / "grasps.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def test_a_client_reads_what_the_run_writes(tmp_path: Path) -> None:
    images, port = plates(tmp_path / "in"), free_port()
    client, _stuck = Client(port), Client(port, 10)
    lines, out = tmp_path / "lines.jsonl", tmp_path / "out"
    given = ["track", str(images), "--fps", "10", "--output", str(out), "--jsonl", str(lines), "--no-video", "--quiet"]
    assert main([*given, "--publish", str(port)]) == 0
    told = [line for line in client.lines() if line["status"] != "silent"]
    written = [json.loads(line) for line in lines.read_text().splitlines()]
    assert told[-1]["frame"] == written[-1]["frame"] and len(told) >= 2
    assert [line["frame"] for line in told] == sorted({line["frame"] for line in told})
    for line in told:
        assert {key: line[key] for key in written[0]} == written[line["frame"]]
        assert line["age_ms"] >= line["latency_ms"] - 0.1
    assert json.loads((out / "run.json").read_text())["options"]["publish"] == str(port)
    with socket.create_server(("127.0.0.1", port)):
        pass  # the port is free again


def test_the_page_of_a_session_publishes_too(tmp_path: Path) -> None:
    images, port = plates(tmp_path / "in"), free_port()
    client = Client(port)
    given = ["live", str(images), "--fps", "25", "--start", "--until-end", "--port", "0", "--quiet"]
    assert main([*given, "--output", str(tmp_path / "out"), "--publish", f"tcp://127.0.0.1:{port}"]) == 0
    told = [line for line in client.lines() if line["status"] != "silent"]
    rows = rows_of(tmp_path / "out")
    assert [line["frame"] for line in told] == [int(row["frame"]) for row in rows]
    for line, row in zip(told, rows, strict=True):
        assert (line["status"], line["contacts"][0][0]) == (row["status"], pytest.approx(float(row["x1"]), abs=1e-4))
        assert line["age_ms"] > 0.0


@pytest.mark.parametrize("verb", ["track", "live"])
def test_what_cannot_be_published_is_told_before_anything_is_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], verb: str
) -> None:
    images, out = plates(tmp_path / "in", 2), tmp_path / "out"
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        for address, part in (
            (f"127.0.0.1:{port}", "0 takes a free one"),
            ("http://here:80", "--publish takes tcp://"),
        ):
            assert main([verb, str(images), "--output", str(out), "--publish", address]) == 2
            told = capsys.readouterr().err
            assert part in told and told.count("\n") == 1
    assert not out.exists()


def test_several_videos_are_not_published_at_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("a.mp4", "b.mp4"):
        (tmp_path / name).write_bytes(b"")
    assert main(["track", str(tmp_path / "*.mp4"), "--publish", "0"]) == 2
    assert "--publish" in capsys.readouterr().err
