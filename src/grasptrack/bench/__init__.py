# SPDX-License-Identifier: Apache-2.0
"""How good it is: the paper's error measures, scores over sequences with truth, and the demonstration."""
