# SPDX-License-Identifier: Apache-2.0
"""All tests below this folder are slow: more than 10 s on one core. They come first: no core waits for a long one."""

from pathlib import Path

import pytest


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if Path(__file__).parent in item.path.parents:
            item.add_marker("slow")
    items.sort(key=lambda item: Path(__file__).parent not in item.path.parents)
