# SPDX-License-Identifier: Apache-2.0
"""What carries the hand, in MuJoCo's language: a gantry of three slides and a turn, or a serial arm; with velocity drives."""

from __future__ import annotations

import numpy as np

from grasptrack.bench.physics import frames, serial
from grasptrack.bench.physics.setting import Arm, Setting
from grasptrack.typing import Floats

TWIST_LIMIT = (0.8, 2.5)
"""m/s and rad/s that the gantry's drives can do."""
DRIVE_FORCE, DRIVE_FORCE_DOWN, DRIVE_TORQUE = 250.0, 80.0, 12.0
"""N, N and N m of the gantry at most: sideways, up and down, about its axis."""
STIFFNESS: Floats = np.array([4000.0, 4000.0, 2000.0, 200.0, 200.0, 200.0])
"""(6,) N m s/rad of the arm's drives: torque for a rate that is off."""
MASSES = (10.0, 14.0, 7.0, 2.0, 2.0, 2.0)
"""kg of what each joint of the arm carries, without what comes after it."""

_GANTRY = ("x", "y", "z", "yaw")


def joint_names(arm: Arm) -> tuple[str, ...]:
    """Names of the joints, from the base."""
    return _GANTRY if arm == "gantry" else serial.JOINTS


def start_joints(setting: Setting, arm: Arm) -> Floats:
    """Where the joints are when the hand is where the setting wants it: m and rad.

    Raises:
        InputError: the arm does not reach it.
    """
    if arm == "arm":
        return serial.start_joints(frames.invert_pose(base_pose(setting)) @ setting.hand)
    R = setting.hand[:3, :3] @ frames.DOWN  # what the turn has to do
    return np.array([*setting.hand[:3, 3], np.arctan2(R[1, 0], R[0, 0])])


def base_pose(setting: Setting) -> Floats:
    """(4, 4) of the arm's base in the world."""
    return serial.base_for(setting.hand, setting.place[:2, 3], setting.belt)


def body_chain_xml(setting: Setting, arm: Arm, grey: str) -> tuple[str, str, str]:
    """What opens the chain of bodies that carries the hand, the hand's place in the last of them, and what closes it."""
    return _gantry_chain_xml() if arm == "gantry" else _serial_chain_xml(setting, grey)


def velocity_drives_xml(arm: Arm) -> str:
    """Velocity drives of all joints, in their order."""
    found = ""
    if arm == "arm":
        for name, stiff, speed, torque in zip(serial.JOINTS, STIFFNESS, serial.SPEED, serial.TORQUE, strict=True):
            found += f'<velocity name="{name}" joint="{name}" kv="{stiff:g}" ctrlrange="{-speed:.9g} {speed:.9g}"'
            found += f' forcerange="{-torque:g} {torque:g}"/>'
        return found
    linear, angular = TWIST_LIMIT
    for name in _GANTRY:
        slides = name in "xyz"
        force = DRIVE_FORCE_DOWN if name == "z" else DRIVE_FORCE if slides else DRIVE_TORQUE
        limit = linear if slides else angular
        found += f'<velocity name="{name}" joint="{name}" kv="{400 if slides else 6}" ctrlrange="{-limit} {limit}"'
        found += f' forcerange="{-force} {force}"/>'
    return found


def _gantry_chain_xml() -> tuple[str, str, str]:
    """Their axes meet in the hand's origin, where the model is built with all joints at 0."""
    opened = ""
    for name, axis in zip("xyz", ("1 0 0", "0 1 0", "0 0 1"), strict=True):
        opened += f'<body name="slide_{name}" gravcomp="1"><joint name="{name}" type="slide" axis="{axis}"/>'
        opened += '<inertial pos="0 0 0" mass=".3" diaginertia=".001 .001 .001"/>'
    opened += '<body name="hinge_yaw" gravcomp="1"><joint name="yaw" type="hinge" axis="0 0 1"'
    opened += ' armature=".01"/><inertial pos="0 0 0" mass=".05" diaginertia=".0005 .0005 .0005"/>'
    return opened, 'quat="0 1 0 0"', 4 * "</body>"


def _serial_chain_xml(setting: Setting, grey: str) -> tuple[str, str, str]:
    at = base_pose(setting)
    turned, origin = _format_numbers(frames.rotation_to_quaternion(at[:3, :3])), np.zeros(3)
    upper, fore = np.array([serial.UPPER, 0.0, 0.0]), np.array([serial.FORE, 0.0, 0.0])
    places = (at[:3, 3], origin, upper, fore, origin, origin)
    # each joint's rod, from its own axis; wrist pitch and yaw are too small to show
    ends = (np.array([0.0, 0.0, serial.COLUMN]), upper, fore, None, None, np.array([0.0, 0.0, -serial.FLANGE]))
    radii = iter(serial.RADII)
    opened = ""
    for name, axis, place, end, mass, low, high in zip(
        serial.JOINTS, serial.AXES, places, ends, MASSES, serial.LOWEST, serial.HIGHEST, strict=True
    ):
        opened += f'<body name="{name}" pos="{_format_numbers(place)}"' + (
            f' quat="{turned}"' if name == "base" else ""
        )
        opened += f' gravcomp="1"><joint name="{name}" type="hinge" axis="{axis}" armature=".05"'
        opened += f' range="{low:.9g} {high:.9g}"/>'
        if end is None:
            opened += f'<inertial pos="0 0 0" mass="{mass}" diaginertia=".002 .002 .002"/>'
        else:
            opened += f'<geom name="{name}" type="capsule" fromto="0 0 0 {_format_numbers(end)}" size="{next(radii)}"'
            opened += f' mass="{mass}" rgba="{grey}"/>'
    at_zero = frames.rotation_to_quaternion(serial.ZERO)
    placed = f'pos="{_format_numbers(-serial.ZERO @ serial.WRIST)}" quat="{_format_numbers(at_zero)}"'
    return opened, placed, len(serial.JOINTS) * "</body>"


def _format_numbers(values: Floats) -> str:
    return " ".join(f"{v:.9g}" for v in np.ravel(values))
