# SPDX-License-Identifier: Apache-2.0
"""What is set up wrongly is named before the hand has gone far, and what is right is not refused: a few of tests/slow's."""

import pytest

from setup_errors import try_right, try_wrong


@pytest.mark.parametrize("kind", ["twist in the base's frame", "dof=4 on a tilted part"])
def test_an_error_of_the_set_up_is_named_soon(kind: str) -> None:
    found = try_wrong(kind, 0)
    assert found.names(kind), found


def test_a_set_up_that_is_right_is_not_refused() -> None:
    found = try_right(0)
    assert not found.refused and found.near, found
