# SPDX-License-Identifier: Apache-2.0
"""Reports of runs, as pages, charts and tables."""
