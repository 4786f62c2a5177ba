# SPDX-License-Identifier: Apache-2.0
"""How good it is: the paper's error measures, scores over sequences with truth, and the demonstration."""

from collections.abc import Callable

Progress = Callable[[str, int, int], None]
"""Called with the name of the step, what is done of it, and all of it."""
