# SPDX-License-Identifier: Apache-2.0
"""All that Tables I to VII are made of, as CSV, and a scorer that works them out anew with NumPy alone."""
