# SPDX-License-Identifier: Apache-2.0
"""What keeps the tree small enough to live in: a budget for each package, imports that go one way, one name a thing.

Where a law does not hold yet, what breaks it is counted here. A change may lower a number, never raise it.
"""

from collections import Counter

import pytest

import house

BUDGETS = {
    "src/grasptrack": 46_245,
    "src/grasptrack/tracking": 10_978,
    "src/grasptrack/servo": 4_908,
    "src/grasptrack/io": 6_903,
    "src/grasptrack/segmentation": 4_530,
    "src/grasptrack/cli": 3_253,
    "src/grasptrack/live": 3_176,
    "src/grasptrack/view": 1_974,
    "src/grasptrack/trackability": 1_912,
    "src/grasptrack/grasp": 1_757,
    "bench": 16_177,
    "research": 12_591,
    "native": 7_531,
    "tests": 48_320,
}
"""Lines of Python, or of C++ in `native`. Who needs more takes them from elsewhere in the package."""
MODULES = 221
SAME_NAMES = 0
"""Names that more than one class has."""
NAMED = ("tracking", "segmentation")
"""Packages in whose functions each decimal number carries a name."""
ONE_WORD = 0.16
"""Share of functions whose name is one word."""
WIDE = 15
"""Functions of the wheel with more than six parameters, those at its edge included."""


def wheel():
    return {name: module for name, module in house.modules().items() if name.split(".")[0] == "grasptrack"}


@pytest.mark.parametrize("folder", BUDGETS)
def test_a_package_keeps_its_budget(folder):
    files = [
        p for p in (house.ROOT / folder).rglob("*") if p.suffix in (".py", ".hpp", ".cpp") and ".venv" not in p.parts
    ]
    assert 0 < sum(path.read_text().count("\n") for path in files) <= BUDGETS[folder]


def test_the_wheel_keeps_its_number_of_files():
    assert len(wheel()) <= MODULES


def test_imports_go_one_way():
    assert house.circles({name: house.imported(module) for name, module in wheel().items()}) == []


def test_nothing_of_the_wheel_imports_the_laboratory():
    for name, module in wheel().items():
        others = {other for other in house.imported(module) if other.split(".")[0] != "grasptrack"}
        assert not others, name


def test_a_class_has_a_name_of_its_own():
    assert sum(len(where) > 1 for where in house.classes().values()) <= SAME_NAMES


def test_functions_take_few_parameters():
    found = [f for module in wheel().values() for f in house.functions(module) if house.parameter_count(f) > 6]
    assert len(found) <= WIDE


def test_names_of_functions_say_what_they_do():
    words = Counter("_" in f.name.strip("_") for module in wheel().values() for f in house.functions(module))
    assert words[False] <= ONE_WORD * words.total()


@pytest.mark.parametrize("package", NAMED)
def test_numbers_have_names(package):
    found = [
        house.nameless_floats(module) for name, module in wheel().items() if name.startswith(f"grasptrack.{package}.")
    ]
    assert not any(found)


def test_a_circle_is_found():
    assert house.circles({"a": {"b"}, "b": {"c"}, "c": {"a"}, "d": {"a"}}) == [["a", "b", "c"]]
