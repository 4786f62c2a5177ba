# SPDX-License-Identifier: Apache-2.0
"""A setting as a MuJoCo model: table, part, cameras, and the hand on its gantry or arm, with velocity drives."""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Mapping
from typing import Any

import numpy as np

from grasptrack.errors import InputError, install_hint
from grasptrack.geometry.homographies import rotation_about_z
from grasptrack.typing import Floats
from grasptrack_bench.physics import frames, serial
from grasptrack_bench.physics.gripper import MAX_OPENING, Gripper
from grasptrack_bench.physics.setting import Arm, Setting


def import_mujoco() -> Any:
    """MuJoCo, drawing through EGL where the user did not choose otherwise and there is no screen."""
    if sys.platform == "linux" and not os.environ.get("DISPLAY"):
        os.environ.setdefault("MUJOCO_GL", "egl")
    try:
        import mujoco
    except ImportError:
        raise InputError(f"the physical world needs MuJoCo: {install_hint('sim')}") from None
    return mujoco


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
    """Where the joints are when the hand is where the setting wants it: m and rad."""
    if arm == "arm":
        return serial.start_joints(frames.inverse_pose(base_pose(setting)) @ setting.hand)
    R = setting.hand[:3, :3] @ frames.DOWN  # what the turn has to do
    return np.array([*setting.hand[:3, 3], np.arctan2(R[1, 0], R[0, 0])])


def base_pose(setting: Setting) -> Floats:
    """(4, 4) of the arm's base in the world."""
    return serial.base_for(setting.hand, setting.place[:2, 3], setting.belt)


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


TIMESTEP = 0.002
"""s."""
FRICTION = 0.8
"""Of the soft pads; that of the part on the table is 0.5."""
GRIP = 20.0
"""N of a finger at most."""
FOOT = 2e-4
"""m, radius of the points on which the part stands."""
TABLE = 12.0
"""m, half of the table's side: as long as a belt may run."""


def build_model_xml(
    setting: Setting, hand: Gripper, arm: Arm, *, levels: Mapping[str, float], texture: str = ""
) -> str:
    """The model in MuJoCo's own language.

    Convex pieces of a part touch fingers and other parts, and it stands on points of its convex hull, as a flat part
    does: that is what keeps the number of contacts small.

    Args:
        setting: what the seed decided.
        hand: its fingers.
        arm: "gantry" or "arm".
        levels: grey levels, 0 to 255, of "table", "part" and "hand".
        texture: file name of the table's picture among the assets; empty for a plain table.
    """
    way = math.atan2(setting.belt[1], setting.belt[0])
    grey = {name: f"{level / 255.0:.4f} {level / 255.0:.4f} {level / 255.0:.4f} 1" for name, level in levels.items()}
    look = f'<texture name="table" type="2d" file="{texture}"/>' if texture else ""
    picture = 'texture="table" texuniform="true" texrepeat="1.6 1.6"' if texture else f'rgba="{grey["table"]}"'
    return f"""<mujoco>
<compiler angle="radian" autolimits="true" inertiafromgeom="auto"/>
<option timestep="{TIMESTEP}" integrator="implicitfast" cone="elliptic" impratio="10"><flag multiccd="enable"/></option>
<visual><global offwidth="{setting.camera.width}" offheight="{setting.camera.height}"/>
<quality shadowsize="1024" offsamples="4"/>
<headlight ambient=".7 .7 .7" diffuse=".25 .25 .25" specular="0 0 0"/><map znear="0.002" zfar="40"/></visual>
<default>
 <geom contype="0" conaffinity="0"/>
 <default class="piece"><geom type="mesh" contype="2" conaffinity="2" mass="0" rgba="{grey["part"]}"/></default>
 <default class="pad"><geom type="box" contype="4" conaffinity="2" condim="4" friction="{FRICTION} .004 .0001"
  priority="1" solref=".004 1" solimp=".95 .99 .001" rgba="{grey["hand"]}"/></default>
 <default class="shaft"><geom type="box" contype="4" conaffinity="2" friction=".3" rgba="{grey["hand"]}"/></default>
 <default class="foot"><geom type="sphere" size="{FOOT}" contype="8" friction=".5 .002 .0001" mass="0" group="4"/></default>
</default>
<asset>{look}<material name="table" {picture} specular="0"/>
{_mesh_assets_xml(setting)}
</asset>
<worldbody>
<light pos=".3 .4 2" dir="-.15 -.2 -1" diffuse=".35 .35 .35" castshadow="false"/>
<body name="table"><joint name="belt" type="slide" axis="{math.cos(way):.9f} {math.sin(way):.9f} 0" limited="false"/>
 <geom name="table" type="box" pos="0 0 -.05" size="{TABLE} {TABLE} .05" mass="5000" conaffinity="12" friction=".5"
  material="table"/></body>
{_part_bodies_xml(setting)}
{_arm_bodies_xml(setting, hand, arm, grey["hand"])}
<body name="bystander" mocap="true"><camera name="bystander" fovy="40"/></body>
</worldbody>
<equality>{_finger_couplings_xml(hand)}</equality>
<actuator>{velocity_drives_xml(arm)}{_finger_drive_xml(hand)}</actuator>
</mujoco>"""


def _mesh_assets_xml(setting: Setting) -> str:
    low, high = 0.0, setting.part.thickness
    found = []
    for number, piece in enumerate(setting.part.pieces):
        both = np.vstack([np.column_stack([piece, np.full(len(piece), z)]) for z in (low, high)])
        found.append(f'<mesh name="piece{number}" inertia="shell" vertex="{_format_numbers(both)}"/>')
    return "\n".join(found)


def part_names(setting: Setting) -> list[str]:
    """Names of the parts' bodies, the first one's first."""
    return ["part", *(f"part{n}" for n in range(1, 1 + len(setting.beside)))]


def _part_bodies_xml(setting: Setting) -> str:
    places = (setting.place, *setting.beside)
    return "\n".join(_part_body_xml(setting, *each) for each in zip(part_names(setting), places, strict=True))


def _part_body_xml(setting: Setting, name: str, place: Floats) -> str:
    part = setting.part
    at, q = place[:3, 3], frames.rotation_to_quaternion(place[:3, :3])
    turned = frames.rotation_to_quaternion(rotation_about_z(part.axis))
    pieces = "".join(f'<geom class="piece" mesh="piece{n}"/>' for n in range(len(part.pieces)))
    heights = FOOT, part.thickness - FOOT  # whichever side is down
    feet = "".join(f'<geom class="foot" pos="{x:.7g} {y:.7g} {z:.7g}"/>' for z in heights for x, y in part.feet)
    return f"""<body name="{name}" pos="{_format_numbers(at)}" quat="{_format_numbers(q)}"><freejoint name="{name}"/>
<inertial pos="0 0 {part.thickness / 2.0:.6g}" quat="{_format_numbers(turned)}" mass="{part.mass:.6g}"
 diaginertia="{_format_numbers(part.inertia)}"/>
{pieces}{feet}</body>"""


def _arm_bodies_xml(setting: Setting, hand: Gripper, arm: Arm, grey: str) -> str:
    opened, placed, closed = _gantry_chain_xml() if arm == "gantry" else _serial_chain_xml(setting, grey)
    camera, q = setting.mount, frames.rotation_to_quaternion(setting.mount[:3, :3] @ frames.DOWN)
    fovy = math.degrees(2.0 * math.atan(setting.camera.height / (2.0 * setting.camera.matrix[0, 0])))
    boxes = "".join(
        f'<geom name="{b.name}" class="shaft" contype="0" conaffinity="0" pos="{_format_numbers(np.array(b.centre))}"'
        f' size="{_format_numbers(np.array(b.half))}" mass=".2"/>'
        for b in hand.fixed_boxes()
    )
    return f"""{opened}<body name="hand" {placed} gravcomp="1"><site name="tip" size=".001" group="5"/>
{boxes}<camera name="hand" pos="{_format_numbers(camera[:3, 3])}" quat="{_format_numbers(q)}" fovy="{fovy:.9g}"/>
{"".join(_finger_body_xml(hand, i) for i in range(hand.fingers))}</body>{closed}"""


def _finger_body_xml(hand: Gripper, finger: int) -> str:
    frame = hand.finger_frame(finger, MAX_OPENING / 2.0)
    boxes = "".join(
        f'<geom name="{b.name}{finger}" class="{b.name}" pos="{_format_numbers(np.array(b.centre))}"'
        f' size="{_format_numbers(np.array(b.half))}" mass=".02"/>'
        for b in hand.finger_boxes(finger)
    )
    at, q = _format_numbers(frame[:3, 3]), _format_numbers(frames.rotation_to_quaternion(frame[:3, :3]))
    return f"""<body name="finger{finger}" pos="{at}" quat="{q}" gravcomp="1">
<joint name="finger{finger}" type="slide" axis="-1 0 0" range="0 {MAX_OPENING / 2.0}" damping="2" armature=".1"
 solreflimit=".004 1"/>{boxes}</body>"""


def _finger_couplings_xml(hand: Gripper) -> str:
    """One drive moves all fingers alike."""
    return "".join(
        f'<joint joint1="finger{i}" joint2="finger0" polycoef="0 1 0 0 0" solref=".004 1"/>'
        for i in range(1, hand.fingers)
    )


def _finger_drive_xml(hand: Gripper) -> str:
    force = GRIP * hand.fingers
    return (
        f'<position name="fingers" joint="finger0" kp="4000" kv="120" ctrlrange="0 {MAX_OPENING / 2.0 + 0.02}"'
        f' forcerange="{-force} {force}"/>'
    )
