# SPDX-License-Identifier: Apache-2.0
"""How good it is: rendered scenes, real videos and simulated approaches with truth, other methods, scores and reports."""
