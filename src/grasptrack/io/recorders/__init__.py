# SPDX-License-Identifier: Apache-2.0
"""What a run can be recorded as: one file a format."""
