# SPDX-License-Identifier: Apache-2.0
"""Error measures and scores of sequences whose truth is known."""
