# SPDX-License-Identifier: Apache-2.0
"""Images in, results out. Nothing here writes to a terminal.

What cannot be read is a `SourceError`, which names it: when a source is opened or, of what only its images show, while it is
iterated over. What cannot be written, and an extra that is not installed, is an `InputError`; what fails while a run writes, as
on a full disk, is the system's `OSError`. Every way to open a source takes what the user named, frames/s as `base.Source`
does, which live sources refuse, and settings by name.
"""
