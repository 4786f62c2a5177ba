# SPDX-License-Identifier: Apache-2.0
"""How good it is: rendered scenes, real videos and simulated approaches with truth, other methods, scores and reports.

Unknown names, files that cannot be read or written and packages that are absent are `InputError`s; a method that is measured
says that it has no answer by a `LostError`, or one of the strategies' `TransferError`s.
"""
