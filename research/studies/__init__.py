# SPDX-License-Identifier: Apache-2.0
"""Studies: what `grasptrack evaluate` does not answer, each run as `python -m research.studies.NAME`, on one thread."""

import os

os.environ |= dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")  # before NumPy loads
