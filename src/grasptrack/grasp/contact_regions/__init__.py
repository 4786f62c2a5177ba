# SPDX-License-Identifier: Apache-2.0
"""The chance that a grasp still closes: how far each contact may slip, against how far it may be off."""

from grasptrack.grasp.contact_regions.chance import (
    CHANCE,
    FRONTAL,
    ClosureCheck,
    Judgement,
    Rectifications,
    chance_of_closing,
)
from grasptrack.grasp.contact_regions.regions import Regions, regions_of

__all__ = [
    "CHANCE",
    "FRONTAL",
    "ClosureCheck",
    "Judgement",
    "Rectifications",
    "Regions",
    "chance_of_closing",
    "regions_of",
]
