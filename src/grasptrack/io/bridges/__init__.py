# SPDX-License-Identifier: Apache-2.0
"""Arms that speak a protocol of their own, each through a process that turns orders into it and watches over them."""
