# SPDX-License-Identifier: Apache-2.0
"""The calibration that the servo makes on the way: focal length and mounting, for files, for other programs, for an alarm."""

from __future__ import annotations

import json
import math
import os
import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from grasptrack import arguments
from grasptrack.equality import compared_by_value
from grasptrack.errors import InputError
from grasptrack.files import read_keys, read_text, write_file
from grasptrack.presentation import to_dict
from grasptrack.servo.camera import NominalCamera, check_pose, pose_of, quaternion_of, rotation_of, rotation_vector
from grasptrack.servo.estimate import Estimate
from grasptrack.servo.model import FOCAL, OFFSET, TURN
from grasptrack.typing import Floats

FILE_FORMAT = 1
"""Of a calibration's file; raised when a key changes its meaning or goes away."""
MAX_FILE_BYTES = 1 << 14
"""Bytes of a calibration's file; none that this writes has nearly as many."""
CAMERA_UNKNOWNS = 7
"""Log focal length; turn (rad, about the camera's axes); offset (m, along the hand's)."""
FILE_ROUNDING = 1e-6
"""By how much numbers of a file may miss what they should be: people shorten them."""
MAX_NUMBER = 1e9
"""No number of a calibration is as large."""
TRANSFORM_KEYS = ("x", "y", "z", "qx", "qy", "qz", "qw")
"""From the hand to the camera: m, and a unit quaternion."""
Kind = Literal["easy_handeye2", "launch"]
_HEAD = "# Where the camera is on the hand, as grasptrack's servo found it on its way.\n"
_LAUNCH = '''"""Publishes where the camera is on the hand, as grasptrack's servo found it on its way."""

from launch import LaunchDescription
from launch_ros.actions import Node


def generate_launch_description():
    return LaunchDescription(
        [
            Node(
                package="tf2_ros",
                executable="static_transform_publisher",
                output="log",
                arguments=[
                    OPTIONS,
                ],
            )
        ]
    )
'''


@compared_by_value
@dataclass(frozen=True)
class HandEye:
    """Camera and mounting, and how well they are known.

    Attributes:
        focal: px.
        centre: (2,) px, where the optical axis meets the image.
        size: (width, height) px of the images.
        mounting: (4, 4), the camera's pose in the hand's frame: its z looks out of it, its x is right in the image, y down.
        covariance: (7, 7), of the log of the focal length, of the turn in rad about the camera's axes, and of the offset in m
            along the hand's. With 4 degrees of freedom no move tells the offset along the approach direction: its variance
            is that of a guess.
    """

    focal: float
    centre: Floats
    size: tuple[int, int]
    mounting: Floats
    covariance: Floats

    @classmethod
    def from_estimate(cls, known: Estimate) -> HandEye:
        """What an estimate tells, with a covariance that is to be believed (`Trust.with_true_covariance`)."""
        camera = known.camera
        width, height = (round(2.0 * c + 1.0) for c in camera.centre.tolist())
        return cls(
            float(camera.focal),
            camera.centre.copy(),
            (width, height),
            pose_of(camera.turn, camera.offset),
            known.covariance[:CAMERA_UNKNOWNS, :CAMERA_UNKNOWNS].copy(),
        )

    def __repr__(self) -> str:
        sd, at = self.standard_deviations(), " ".join(f"{v:.4f}" for v in self.mounting[:3, 3].tolist())
        return (
            f"HandEye({self.focal:.1f} px within {100.0 * sd[FOCAL]:.2g} %, mounted at {at} m "
            f"within {' '.join(f'{1e3 * v:.2g}' for v in sd[OFFSET].tolist())} mm, "
            f"turned within {' '.join(f'{math.degrees(v):.2g}' for v in sd[TURN].tolist())} degrees)"
        )

    def to_dict(self) -> dict[str, Any]:
        """Its attributes by name as plain values, for JSON and data frames; what is not finite is None."""
        return to_dict(self)

    def standard_deviations(self) -> Floats:
        """(7,) of the log of the focal length, the turn (rad), the offset (m)."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))

    def nominal(self, distance: float = 0.4) -> NominalCamera:
        """What a servo with `law="nominal"` can begin with.

        Args:
            distance: m from the camera to the object at the start; a guess within a factor of 2.

        Raises:
            InputError: a distance that is not positive.
        """
        return NominalCamera(self.focal, self.mounting, distance)

    def difference(self, other: HandEye) -> Floats:
        """(7,), what leads from this calibration to another, in the order of the covariance."""
        out = np.empty(CAMERA_UNKNOWNS)
        out[FOCAL] = math.log(other.focal / self.focal)
        out[TURN] = rotation_vector(self.mounting[:3, :3].T @ other.mounting[:3, :3])
        out[OFFSET] = other.mounting[:3, 3] - self.mounting[:3, 3]
        return out

    def contradicted_by(self, other: HandEye) -> float:
        """The squared difference from another calibration, in standard deviations of both.

        It is a chi-square with 7 degrees of freedom where both are right, and come of different images.
        """
        d = self.difference(other)
        return float(d @ np.linalg.solve(self.covariance + other.covariance, d))

    # --- files ------------------------------------------------------------------------------------

    @arguments.checked(arguments.text, path=arguments.instance(str, os.PathLike))
    def save(
        self,
        path: str | os.PathLike[str],
        *,
        hand: str = "tool0",
        camera: str = "camera_optical_frame",
        base: str = "base_link",
    ) -> None:
        """Write a YAML file, as `HandEye.load` reads it; a file of that name is replaced.

        easy_handeye (ROS 1) reads it as its own: `parameters`, and `transformation` with x, y, z in m and qx, qy, qz, qw, from
        the hand to the camera. What it does not know, it leaves alone: under `grasptrack` focal length and axis in px, and
        standard deviations and covariance of everything.

        Args:
            path: of the file.
            hand: name of the frame whose pose the servo was given.
            camera: name of the camera's optical frame.
            base: name of the frame in which the hand's pose was.

        Raises:
            InputError: it cannot be written.
        """
        sd = self.standard_deviations()
        transform = "\n".join(f"  {name}: {value!r}" for name, value in self._transform_values().items())
        rows = "\n".join(f"    - {_yaml_list(row)}" for row in self.covariance)
        text = f"""{_HEAD}parameters:
  namespace: {json.dumps(Path(path).stem)}
  move_group_namespace: "/"
  move_group: "manipulator"
  eye_on_hand: true
{_frame_names(base, hand, camera)}
transformation:  # from the hand to the camera's optical frame: m, and a unit quaternion
{transform}
grasptrack:
  format: {FILE_FORMAT}
  size_px: {list(self.size)}  # width, height
  focal_px: {self.focal!r}
  centre_px: {_yaml_list(self.centre)}  # of the optical axis; the centre of the top-left pixel is at 0, 0
  focal_sd_px: {float(self.focal * sd[FOCAL])!r}
  turn_sd_rad: {_yaml_list(sd[TURN])}  # about the camera's x, y, z
  offset_sd_m: {_yaml_list(sd[OFFSET])}  # along the hand's x, y, z
  covariance:  # of the log of the focal length; turn, rad, about the camera's axes; offset, m, along the hand's
{rows}
"""
        write_file(Path(path), text, "calibration")

    @arguments.checked(arguments.text, path=arguments.instance(str, os.PathLike))
    def export(
        self,
        path: str | os.PathLike[str],
        kind: Kind,
        *,
        hand: str = "tool0",
        camera: str = "camera_optical_frame",
        base: str = "base_link",
    ) -> None:
        """Write a file for another program, which holds no more than that program reads; a file of that name is replaced.

        Args:
            path: of the file; for easy_handeye2 the calibration's name and `.calib`, in the folder of its calibrations.
            kind: "easy_handeye2", or "launch": a launch file of ROS 2 with a static_transform_publisher, as MoveIt's hand-eye
                calibration saves one.
            hand: name of the hand's frame, as in `save`.
            camera: of the camera's.
            base: of the robot's.

        Raises:
            InputError: another kind, or it cannot be written.
        """
        if kind not in get_args(Kind):
            raise InputError(f'a calibration is exported for {" or ".join(get_args(Kind))}, not "{kind}"', kind=kind)
        if kind == "launch":
            options = map(json.dumps, self.static_transform(hand=hand, camera=camera))
            text = _LAUNCH.replace("OPTIONS", ",\n                    ".join(options))
        else:
            sd, transform = self.standard_deviations(), self._transform_values()
            rows = [f"    {name.removeprefix('q')}: {value!r}" for name, value in transform.items()]
            text = f"""{_HEAD}parameters:
  name: {json.dumps(Path(path).stem)}
  calibration_type: "eye_in_hand"
{_frame_names(base, hand, camera)}
  freehand_robot_movement: true
transform:
  translation:  # m; standard deviations {_yaml_list(sd[OFFSET])}
{chr(10).join(rows[:3])}
  rotation:  # standard deviations in rad about the camera's axes {_yaml_list(sd[TURN])}
{chr(10).join(rows[3:])}
"""
        write_file(Path(path), text, "calibration")

    def static_transform(self, *, hand: str = "tool0", camera: str = "camera_optical_frame") -> list[str]:
        """The arguments of `ros2 run tf2_ros static_transform_publisher`: m, a quaternion, and the frames' names."""
        out = [part for name, value in self._transform_values().items() for part in (f"--{name}", repr(value))]
        return [*out, "--frame-id", hand, "--child-frame-id", camera]

    def static_transform_command(self, *, hand: str = "tool0", camera: str = "camera_optical_frame") -> str:
        """The same as one line for a shell."""
        return "ros2 run tf2_ros static_transform_publisher " + shlex.join(
            self.static_transform(hand=hand, camera=camera)
        )

    @classmethod
    @arguments.checked(path=arguments.instance(str, os.PathLike))
    def load(cls, path: str | os.PathLike[str]) -> HandEye:
        """A calibration from a file that `HandEye.save` wrote; keys and units as there.

        Raises:
            InputError: the file cannot be read, or what it holds is no such calibration. The message names the file.
        """
        file = Path(path)
        try:
            return cls._from_content(read_keys(read_text(file, "calibration", MAX_FILE_BYTES)))
        except InputError as error:
            raise InputError(f'calibration "{file}": {error}', **error.values, path=str(file)) from None

    @classmethod
    def _from_content(cls, content: dict[str, Any]) -> HandEye:
        """The calibration that a file holds, or an InputError."""
        own, transform = content.get("grasptrack"), content.get("transformation")
        if not isinstance(own, dict) or not isinstance(transform, dict):
            raise InputError("has no keys grasptrack and transformation, as HandEye.save writes them")
        if own.get("format") != FILE_FORMAT:
            raise InputError(f"has the format {own.get('format')!r}, not {FILE_FORMAT}")
        parameters = content.get("parameters")
        if isinstance(parameters, dict) and parameters.get("eye_on_hand", True) is not True:
            raise InputError("is of a camera that is not on the hand: eye_on_hand is true")
        names = ", ".join(TRANSFORM_KEYS)
        values = _numbers_of([transform.get(name) for name in TRANSFORM_KEYS], (7,), f"transformation, with {names}")
        if abs(float(values[3:] @ values[3:]) - 1.0) > FILE_ROUNDING:
            raise InputError("has a unit quaternion qx, qy, qz, qw", quaternion=values[3:].tolist())
        size = own.get("size_px")
        if not isinstance(size, list) or len(size) != 2 or not all(type(v) is int and v > 0 for v in size):
            raise InputError(f"has size_px, width and height in px, not {size!r}")
        focal = float(_numbers_of([own.get("focal_px")], (1,), "focal_px, a number of px")[0])
        if not focal > 0.0:
            raise InputError(f"has a focal_px that is positive, not {focal:g}", focal=focal)
        covariance = _numbers_of(own.get("covariance"), (7, 7), "covariance, 7 rows of 7 numbers")
        sd = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
        relative = covariance / np.outer(sd, sd)
        if np.abs(relative - relative.T).max() > FILE_ROUNDING or np.linalg.eigvalsh(relative).min() < -FILE_ROUNDING:
            raise InputError("has a covariance that is symmetric, without negative eigenvalues")
        centre = _numbers_of(own.get("centre_px"), (2,), "centre_px, x and y in px")
        mounting = pose_of(rotation_of(values[3:]), values[:3])
        return cls(focal, centre, (size[0], size[1]), check_pose(mounting), 0.5 * (covariance + covariance.T))

    def _transform_values(self) -> dict[str, float]:
        """Position in m and unit quaternion of the camera in the hand's frame, by their keys."""
        values = (*self.mounting[:3, 3].tolist(), *quaternion_of(self.mounting[:3, :3]).tolist())
        return dict(zip(TRANSFORM_KEYS, values, strict=True))


def _yaml_list(values: Floats) -> str:
    return f"[{', '.join(repr(float(v)) for v in values)}]"


def _frame_names(base: str, hand: str, camera: str) -> str:
    """The frames' names as all of easy_handeye's files have them."""
    return f"""  robot_base_frame: {json.dumps(base)}
  robot_effector_frame: {json.dumps(hand)}
  tracking_base_frame: {json.dumps(camera)}
  tracking_marker_frame: "grasp\""""


def _numbers_of(value: Any, shape: tuple[int, ...], what: str) -> Floats:
    """Finite numbers of a file as an array of a shape, or an InputError that says what the file has to have."""
    rows = value if len(shape) == 2 else [value]
    listed = isinstance(rows, list) and all(isinstance(row, list) and len(row) == shape[-1] for row in rows)
    if not listed or sum(map(len, rows)) != math.prod(shape):
        raise InputError(f"has {what}")
    if any(arguments.number(v) or not abs(v) < MAX_NUMBER for row in rows for v in row):
        raise InputError(f"has {what}")
    return np.array(value, dtype=np.float64)
