# SPDX-License-Identifier: Apache-2.0
"""The command line: one file a verb. Whatever is slow to import is imported by the verb that needs it.

What an option says and cannot be is raised as an `InputError`, which `main` alone turns into a line and an exit status.
"""
