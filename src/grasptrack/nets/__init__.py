# SPDX-License-Identifier: Apache-2.0
"""Nets that propose regions, registered as entry points `grasptrack.segmenters`; nothing else imports them unasked."""
