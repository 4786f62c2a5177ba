# SPDX-License-Identifier: Apache-2.0
"""What was asked once and can be asked again: the paper's tables and the studies, run from a checkout."""
