# SPDX-License-Identifier: Apache-2.0
"""Contacts, hands, force closure, and the choice of a grasp."""
