# SPDX-License-Identifier: Apache-2.0
"""Nets that propose regions, registered as entry points `grasptrack.segmenters`; nothing else imports them unasked.

A package or a file that is absent, and a file that cannot be run as such a net, is an `InputError`.
"""
