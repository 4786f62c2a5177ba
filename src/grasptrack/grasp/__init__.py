# SPDX-License-Identifier: Apache-2.0
"""Contacts, hands, force closure, and the choice of a grasp."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from grasptrack.grasp.contacts import Grasp, parse_contacts

__all__ = ["Grasp", "parse_contacts"]


def __getattr__(name: str) -> object:
    if name not in __all__:
        raise AttributeError(f"module 'grasptrack.grasp' has no attribute '{name}'")
    from grasptrack.grasp import contacts

    return getattr(contacts, name)
