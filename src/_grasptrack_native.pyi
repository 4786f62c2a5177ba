# SPDX-License-Identifier: Apache-2.0
"""Compiled kernels of grasptrack; `grasptrack.kernels.reference` defines each of them."""

from grasptrack.kernels.reference import *
