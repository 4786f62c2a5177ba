# SPDX-License-Identifier: Apache-2.0
"""A servo from a file: what is told counts, and whatever is wrong is one line that names the file and what would be right."""

import re
from dataclasses import fields
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

import grasptrack as gt
from grasptrack.errors import InputError, bench_hint
from grasptrack.io.arms import open_arm
from grasptrack.servo.setup import NUMBERS, TABLES, ServoSetup
from grasptrack.servo.steering import SLOW
from watched import FedCamera

pytest.importorskip("tomllib", reason="TOML needs Python 3.11")

KEYS = [
    "arm",
    "goal",
    *NUMBERS,
    *TABLES,
    *(f"{table}.{f.name}" for table, kind in TABLES.items() for f in fields(kind)),
]


def load(folder: Path, text: str) -> ServoSetup:
    file = folder / "servo.toml"
    file.write_text(text)
    return ServoSetup.load(file)


def refusal(folder: Path, text: str) -> str:
    with pytest.raises(InputError) as told:
        load(folder, text)
    line = str(told.value)
    assert "\n" not in line and "servo.toml" in line
    return line


def test_what_is_told_counts_and_the_rest_is_slow(tmp_path: Path) -> None:
    gt.Goal.fingertips([(100.0, 200.0), (300.0, 200.0)], 0.08).save(tmp_path / "goal.json")
    text = 'arm = "sim:"\ngoal = "goal.json"\ndof = 6\nlatency = 0.03\n[limits]\nlinear = 0.1\n[bounds]\nblind = 0.2\n'
    setup = load(tmp_path, text)
    servo = setup.make_servo((640, 480))
    assert servo.dof == 6 and servo.goal == gt.Goal.load(tmp_path / "goal.json")
    assert (servo.limits.linear, servo.limits.angular) == (0.1, SLOW.angular)
    assert setup.options["bounds"] == gt.Bounds(blind=0.2) and setup.options["latency"] == 0.03
    assert load(tmp_path, 'arm = "sim:"').options["limits"] == SLOW


@pytest.mark.parametrize("key", KEYS)
def test_a_misspelt_key_names_the_right_one(tmp_path: Path, key: str) -> None:
    table, _, name = key.rpartition(".")
    wrong = f"{name}s"
    text = f'arm = "sim:"\n[{table}]\n{wrong} = 1\n' if table else f"arm2 = 1\n{wrong} = 1\n".removeprefix("arm2 = 1\n")
    line = refusal(tmp_path, text)
    assert f'did you mean "{key}"?' in line and f"{wrong}" in line


@pytest.mark.parametrize("key", [key for key in KEYS if key not in TABLES])
@pytest.mark.parametrize("value", ["[1]", "2020-01-01", "{ x = 1 }"])
def test_a_value_of_another_type_is_told(tmp_path: Path, key: str, value: str) -> None:
    table, _, name = key.rpartition(".")
    head = "" if key == "arm" else 'arm = "sim:"\n'
    line = refusal(tmp_path, f"{head}[{table}]\n{name} = {value}\n" if table else f"{head}{name} = {value}\n")
    assert (name in line and "must be" in line) or "needs arm" in line or "goal is the name" in line


@pytest.mark.parametrize("table", TABLES)
def test_a_table_is_no_number(tmp_path: Path, table: str) -> None:
    assert f"[{table}]" in refusal(tmp_path, f'arm = "sim:"\n{table} = 3\n')


@pytest.mark.parametrize("key", [key for key in KEYS if key.partition(".")[0] in ("limits", "bounds", "gain")])
@pytest.mark.parametrize("value", ["-1.0", "0.0", "nan"])
def test_bounds_that_are_none_are_told(tmp_path: Path, key: str, value: str) -> None:
    table, _, name = key.partition(".")
    if name:
        line = refusal(tmp_path, f'arm = "sim:"\n[{table}]\n{name} = {value}\n')
        assert f"[{table}]" in line and ("positive" in line or "finite" in line)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", "is empty"),
        ("x = [", "no TOML"),
        ('dof = 4', "needs arm"),
        ('arm = "sim:"\ngoal = "goal.json"', "goal.json"),
        ('arm = "sim:"\ndof = 5', "4 or 6"),
        ('arm = "sim:"\nlatency = -0.1', "latency 0 or more"),
        ('arm = "sim:"\nretries = -1', "retries are 0 or more"),
        ('arm = "sim:"\nmax_age = 0.0', "age is positive"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_one_line(tmp_path: Path, text: str, told: str) -> None:
    assert told in refusal(tmp_path, text)


def test_a_file_that_is_not_there_is_told(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"nowhere\.toml"):
        ServoSetup.load(tmp_path / "nowhere.toml")


@given(st.text(max_size=60))
def test_any_text_is_a_setup_or_one_line(tmp_path_factory: pytest.TempPathFactory, text: str) -> None:
    file = tmp_path_factory.mktemp("setups") / "servo.toml"
    file.write_text(text, encoding="utf-8", errors="replace")
    with pytest.raises(InputError) as told:
        ServoSetup.load(file)
    assert "\n" not in str(told.value)


@pytest.mark.parametrize(
    ("url", "told"),
    [
        ("scara:192.0.2.7", "tcp://HOST:PORT, modbus:, ros2:, sim:, ur:"),
        ("", "tcp://HOST:PORT, modbus:, ros2:, sim:, ur:"),
        ("tcp:5556", "as tcp://192.0.2.7:5556"),
        ("tcp://host", "as tcp://192.0.2.7:5556"),
        ("tcp://host:x", "as tcp://192.0.2.7:5556"),
        ("tcp://host:1/path", "as tcp://192.0.2.7:5556"),
        ("tcp://127.0.0.1:1", "no arm answers"),
        ("sim:", "sim:"),
    ],
)
def test_an_arm_that_is_none_names_what_would_be_right(url: str, told: str) -> None:
    with pytest.raises(InputError) as error:
        open_arm(url, FedCamera())
    assert told in str(error.value) and "\n" not in str(error.value)


def test_without_the_bench_the_simulation_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    from grasptrack import plugins

    monkeypatch.setattr(plugins, "_find_entries", lambda group: {})
    for ask in (lambda: open_arm("sim:", FedCamera()), lambda: gt.open_source("sim:spanner")):
        with pytest.raises(InputError, match=re.escape(bench_hint("sim"))):
            ask()
