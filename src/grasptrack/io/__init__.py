# SPDX-License-Identifier: Apache-2.0
"""Images in, results out. Nothing here writes to a terminal."""
