# SPDX-License-Identifier: Apache-2.0
"""A physical world: a flat part on a table, and a hand with a camera that can be moved, closed and lifted."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from grasptrack.errors import InputError
from grasptrack.typing import Floats, Pixels
from grasptrack_bench.physics import frames, model, serial
from grasptrack_bench.physics.film import Film, make_film
from grasptrack_bench.physics.gripper import BESIDE, MAX_OPENING, make_gripper
from grasptrack_bench.physics.images import Images, images_of
from grasptrack_bench.physics.model import import_mujoco
from grasptrack_bench.physics.pull import PULL_S, Pull, choose_pull
from grasptrack_bench.physics.serial import joint_rates
from grasptrack_bench.physics.setting import BLACKOUT_S, Arm, Scenario, Setting, hand_mask, sample_setting
from grasptrack_bench.simulation.outlines import Shape

PERIOD_S = 0.04
"""Of the control: 25 images a second."""
ACCELERATION = (5.0, 20.0)
"""m/s^2 and rad/s^2 that the drives are given at most."""
PUSH_S = 0.3
PUSHED, PULLED = 80.0, 300.0
"""1/s at which a part that is pushed or pulled comes to its speed: who pulls holds it."""
CLOSING_SPEED, TOUCH_SPEED = 0.12, 0.06
"""m/s of a finger, and of the hand feeling for the table."""
YIELD = 0.25
"""rad/s of an arm's hand that gives way to the table."""
FELT_N = 5.0
"""N on the pads that no hand overlooks."""
TOUCH_N = 2.0
"""N at the tips at which the hand has touched."""
FEEL = 0.03
"""m that the hand goes down at most to feel for the table."""
LIFTED = 0.05
"""m by which a part that is held must come up, and stay for a second."""


class World:
    """A robot's hand over a table, in MuJoCo's physics. The seed decides all that is drawn: the same one is the same world.

    Args:
        outline: the part, of area 1.
        seed: of everything.
        scenario: "static", "pushed", "belt", "blackout" or "pulled"; see `setting.draw`.
        arm: "gantry", which moves in x, y, z and turns, or "arm", six hinges in a row.
        fingers: 2 or 3.
        images: "mujoco" draws the camera's images by MuJoCo, which needs offscreen OpenGL; "planar" by this package, which
            needs none and is several times as fast; "auto" by MuJoCo where it can.
        axis: see `setting.draw`.
        setting: in place of the one that the seed decides.

    Attributes:
        chosen: number of the part that the truth, a push and a pull are of: 0, or that of one beside it.
        gone: numbers of the parts that were taken away.
        images: who draws the hand's.
        watch: called once in every control period, also while the hand closes and lifts; None.
        failure: after a lift that failed, how.
        short_s: s in which an arm did not make nine tenths of the twist, at the end of its reach or of its joints' speed.
    """

    def __init__(
        self,
        outline: Shape,
        *,
        seed: int,
        scenario: Scenario = "static",
        arm: Arm = "gantry",
        fingers: Literal[2, 3] = 2,
        images: Literal["auto", "mujoco", "planar"] = "auto",
        axis: float | None = None,
        setting: Setting | None = None,
    ) -> None:
        self._mj = import_mujoco()
        self.hand = make_gripper(fingers)
        if setting is None:
            setting = sample_setting(outline, self.hand, seed=seed, scenario=scenario, arm=arm, axis=axis)
        self.setting, self.chosen, self.gone = setting, 0, set[int]()
        self.shape, self.seed, self.scenario, self.arm = outline, seed, scenario, arm
        self.images: Images = images_of(images, self.setting, self.hand, outline.name, seed)
        self.model = self._mj.MjModel.from_xml_string(
            model.build_model_xml(self.setting, self.hand, arm, levels=self.images.levels, texture=self.images.texture),
            self.images.assets,
        )
        self.data = self._mj.MjData(self.model)
        self._resolve_indices()
        self._set_initial_state()
        self.images.bind(self.model)
        self._ctrl = np.zeros(6)
        self._last = np.zeros(6)
        self.failure = ""
        self.short_s = 0.0
        self.watch: Callable[[], None] | None = None
        self._steps = 0
        self._pull: tuple[float, Pull] | None = None  # when it began, s

    def _resolve_indices(self) -> None:
        m = self.model
        self._dofs = np.array([m.joint(name).dofadr[0] for name in model.joint_names(self.arm)])
        self._qpos = np.array([m.joint(name).qposadr[0] for name in model.joint_names(self.arm)])
        self._belt = int(m.joint("belt").dofadr[0])
        names = model.part_names(self.setting)
        self._parts = [int(m.body(name).id) for name in names]
        self._part_dofs = [int(m.joint(name).dofadr[0]) for name in names]
        self._tip = int(m.site("tip").id)
        self._finger = [int(m.joint(f"finger{i}").qposadr[0]) for i in range(self.hand.fingers)]
        self._pads = {int(m.geom(f"pad{i}").id): i for i in range(self.hand.fingers)}
        self._grip = int(m.actuator("fingers").id)
        self._table = int(m.geom("table").id)
        self._jacobian = np.zeros((3, m.nv)), np.zeros((3, m.nv))

    def _set_initial_state(self) -> None:
        """The joints at which the hand is where the setting wants it."""
        self.data.qpos[self._qpos] = model.start_joints(self.setting, self.arm)
        self.data.qvel[self._belt] = float(np.hypot(*self.setting.belt))
        for dof in self._part_dofs:
            self.data.qvel[dof : dof + 2] = self.setting.belt
        self._mj.mj_forward(self.model, self.data)

    # --- what a robot's driver offers --------------------------------------------------------------

    def time(self) -> float:
        """s since the start."""
        return float(self.data.time)

    def pose(self) -> Floats:
        """(4, 4) of the hand in the robot's base, from the joints' sensors."""
        return frames.pose_of(
            self.data.site_xmat[self._tip].reshape(3, 3).copy(), self.data.site_xpos[self._tip].copy()
        )

    def image(self) -> Pixels:
        """(480, 640) grey image of the hand's camera now. While the view is blocked it shows what blocks it."""
        return self.images.hand(self)

    def blocked(self) -> bool:
        """Whether something is before the camera."""
        return self.setting.blackout <= self.time() < self.setting.blackout + BLACKOUT_S

    def opening(self) -> float:
        """m between two fingers, twice the distance from the middle for three, as the gripper reports it: never below 0."""
        return max(0.0, self._gap())

    def _gap(self) -> float:
        """The same; below 0 where fingers that meet give way a little."""
        return MAX_OPENING - 2.0 * float(self.data.qpos[self._finger[0]])

    def fingertips(self) -> tuple[Floats, float]:
        """Where the tips of the open fingers are seen, as a person would mark them once: (k, 2) px; and their opening in m."""
        mount = frames.inverse_pose(self.setting.mount)
        opening = self.opening()
        return frames.project_points(self.setting.camera.matrix, mount, self.hand.tips(opening)), opening

    def ignore(self) -> Pixels:
        """(480, 640) 255 where the open hand is in its own camera's way, marked generously."""
        return hand_mask(self.setting.camera, self.setting.mount, self.hand, self.opening(), grow=5)

    def touches(self) -> bool:
        """Whether the pads press on anything, as the drives feel it."""
        return bool(self.finger_forces().sum() >= FELT_N)

    def move(self, twist: ArrayLike) -> None:
        """Move the hand for one control period.

        Args:
            twist: (6,) m/s and rad/s in the hand's frame. What the drives cannot do, they do as far as they can; a gantry
                leaves turns about x and y out.
        """
        wanted = np.asarray(twist, dtype=np.float64)
        if wanted.shape != (6,) or not np.isfinite(wanted).all():
            raise InputError(f"a twist is six finite numbers, not {np.asarray(twist).tolist()}")
        self._last = wanted
        for _ in range(round(PERIOD_S / model.TIMESTEP)):
            self._step_physics(wanted)

    def close(self, width: float | None = None) -> bool:
        """Go down until the tips touch the table, then close; the hand goes on sideways as it was told last.

        Args:
            width: m between the contacts, where it is known: the fingers come nearer before the hand goes down.

        Returns:
            Whether the fingers have something between them. What the gripper reads then is `opening`.
        """
        along = self._last.copy()
        along[2:] = 0.0
        if self.setting.pulls and self._pull is None:
            self._pull = self.time(), self._choose_pull(width)
        if width is not None:
            self._close_to_opening(along, min(MAX_OPENING, width + 2.0 * BESIDE))
        self._descend_to_contact(along)
        self._close_fingers(along)
        return self.holds()

    def holds(self) -> bool:
        """Two fingers that press hold something; of three, one may have come too late and find it held."""
        return self.opening() > 0.001 and int((self.finger_forces() > 1.0).sum()) >= 2

    def open(self) -> None:
        """Open the fingers again as far as they go; the hand goes on as it was told last."""
        self.data.ctrl[self._grip] = min(self.data.ctrl[self._grip], MAX_OPENING / 2.0)
        while self.data.ctrl[self._grip] > 0.0:
            self.data.ctrl[self._grip] = max(0.0, self.data.ctrl[self._grip] - CLOSING_SPEED * model.TIMESTEP)
            self._step_physics(self._last)
        for _ in range(50):  # the fingers come after their drive
            self._step_physics(self._last)

    def lift(self) -> bool:
        """Raise the hand by 12 cm, wait a second, and tell whether the part came along by 5 cm and stayed."""
        part = self._parts[self.chosen]
        start = float(self.data.xpos[part][2])
        up = self.pose()[:3, :3].T @ np.array([0.0, 0.0, 0.12])
        for _ in range(25):
            self.move([*up, 0.0, 0.0, 0.0])
        heights = []
        for _ in range(25):
            self.move(np.zeros(6))
            heights.append(float(self.data.xpos[part][2]) - start)
        self.failure = "" if min(heights) >= LIFTED else "slipped" if max(heights) > 0.004 else "stayed on the table"
        return min(heights) >= LIFTED

    def links(self) -> list[serial.Rod]:
        """The arm's links as rods in the world; none of a gantry."""
        if self.arm == "gantry":
            return []
        at = model.base_pose(self.setting)
        rods = serial.link_rods(self.data.qpos[self._qpos])
        return [serial.Rod(at[:3, :3] @ a + at[:3, 3], at[:3, :3] @ b + at[:3, 3], radius) for a, b, radius in rods]

    def bystander(self) -> Pixels:
        """(480, 640, 3) BGR image of a camera that stands beside and goes along, with shadows."""
        return self._film.bystander(self)

    def hand_in_colour(self) -> Pixels:
        """(480, 640, 3) BGR of what `image` shows in grey, without its noise."""
        return self._film.hand(self)

    @cached_property
    def _film(self) -> Film:
        return make_film(self)

    # --- the truth, for judges alone --------------------------------------------------------------

    def part_pose(self) -> Floats:
        """(4, 4) of the part in the world; its origin is at the centroid of its foot."""
        return self._pose_of_part(self.chosen)

    def part_poses(self) -> dict[int, Floats]:
        """(4, 4) of each part that is still there, by its number."""
        return {k: self._pose_of_part(k) for k in range(len(self._parts)) if k not in self.gone}

    def _pose_of_part(self, number: int) -> Floats:
        part = self._parts[number]
        return frames.pose_of(self.data.xmat[part].reshape(3, 3).copy(), self.data.xpos[part].copy())

    def touches_another(self, number: int) -> bool:
        """Whether a part lies against another one, on it, or under it."""
        pairs = (self.model.geom_bodyid[[c.geom1, c.geom2]].tolist() for c in self.data.contact[: self.data.ncon])
        return any(self._parts[number] in pair and set(pair) <= set(self._parts) for pair in pairs)

    def take_away(self, number: int) -> None:
        """A part is nowhere any more: nothing touches it, and no image shows it."""
        part, dof = self._parts[number], self._part_dofs[number]
        own = self.model.geom_bodyid == part
        self.model.geom_contype[own] = self.model.geom_conaffinity[own] = 0
        self.model.body_gravcomp[part], self.data.qvel[dof : dof + 6] = 1.0, 0.0
        self.gone.add(number)

    def camera_pose(self) -> Floats:
        """(4, 4) of the hand's camera in the world."""
        return np.asarray(self.pose() @ self.setting.mount, dtype=np.float64)

    def outline_to_image(self) -> Floats:
        """(3, 3) from the part's outline in m to px, for its upper face."""
        return frames.plane_to_image(
            self.setting.camera.matrix, self.camera_pose(), self.part_pose(), self.setting.part.thickness
        )

    def belt_travel(self) -> Floats:
        """(2,) m that the table has moved."""
        return np.asarray(self.setting.belt * self.data.time, dtype=np.float64)

    def finger_forces(self) -> Floats:
        """(k,) N with which each pad presses on anything now."""
        forces, six = np.zeros(self.hand.fingers), np.zeros(6)
        for i in range(self.data.ncon):
            contact = self.data.contact[i]
            for geom in (contact.geom1, contact.geom2):
                if geom in self._pads:
                    self._mj.mj_contactForce(self.model, self.data, i, six)
                    forces[self._pads[geom]] += abs(six[0])
        return forces

    # --- steps -----------------------------------------------------------------------------------

    def _step_physics(self, wanted: Floats) -> None:
        """One step of the physics toward a twist in the hand's frame."""
        m, d = self.model, self.data
        limit = np.repeat(np.array(ACCELERATION) * model.TIMESTEP, 3)
        self._ctrl += np.clip(wanted - self._ctrl, -limit, limit)
        self._mj.mj_jacSite(m, d, *self._jacobian, self._tip)
        R = d.site_xmat[self._tip].reshape(3, 3)
        J = np.vstack([R.T @ each[:, self._dofs] for each in self._jacobian])
        if self.arm == "arm":
            rates = joint_rates(J, self._ctrl, d.qpos[self._qpos])
            left = np.linalg.norm(J @ rates - self._ctrl)
            self.short_s += model.TIMESTEP if left > 0.1 * np.linalg.norm(self._ctrl) else 0.0
        else:
            rates = np.linalg.lstsq(J, self._ctrl, rcond=1e-6)[0]
        d.ctrl[: len(self._dofs)] = rates
        d.qvel[self._belt] = float(np.hypot(*self.setting.belt))
        self._apply_push()
        self._mj.mj_step(m, d)
        self._steps += 1
        if self.watch is not None and self._steps % round(PERIOD_S / model.TIMESTEP) == 0:
            self.watch()

    def _apply_push(self) -> None:
        """Somebody's finger: it makes the part move at a speed for a moment, and lets go."""
        force = self.data.xfrc_applied[self._parts[self.chosen]]
        force[:] = 0.0
        if self._pull is not None:
            start, pull = self._pull
            if start <= self.data.time < start + PULL_S:
                force[:] = self._force_toward(*pull.velocity(self.data.time - start), firm=PULLED)
        if self.setting.push is None:
            return
        start, velocity, turn = self.setting.push
        if start <= self.data.time < start + PUSH_S:
            force[:] = self._force_toward(velocity, turn, firm=PUSHED)

    def _force_toward(self, velocity: Floats, turn: float, firm: float) -> Floats:
        """(6,) N and N m that bring the part to a velocity (2,) and a turn, m/s and rad/s, at so much of the difference a s."""
        dof, force = self._part_dofs[self.chosen], np.zeros(6)
        mass, qvel = self.setting.part.mass, self.data.qvel[dof : dof + 6]
        force[:2] = firm * mass * (velocity - qvel[:2])
        force[5] = firm * float(self.setting.part.inertia[2]) * (turn - qvel[5])
        return force

    def _choose_pull(self, width: float | None) -> Pull:
        """How somebody pulls the part away from fingers that are about to close on so many m."""
        s, opening = self.setting, MAX_OPENING if width is None else min(MAX_OPENING, width + 2.0 * BESIDE)
        return choose_pull(s.pulls, s.part, self.part_pose(), self.hand, self.pose(), opening, s.camera, s.mount)

    def _close_to_opening(self, along: Floats, opening: float) -> None:
        target = (MAX_OPENING - opening) / 2.0
        while self.data.ctrl[self._grip] < target:
            self.data.ctrl[self._grip] = min(target, self.data.ctrl[self._grip] + CLOSING_SPEED * model.TIMESTEP)
            self._step_physics(along)

    def _descend_to_contact(self, along: Floats) -> None:
        """Straight down in the hand's frame until the tips press on the table; an arm gives way until all do."""
        twist, limit = along.copy(), self.time() + FEEL / TOUCH_SPEED
        twist[2] = TOUCH_SPEED
        while self.time() < limit and self.finger_forces().sum() < TOUCH_N:
            self._step_physics(twist)
        if self.arm == "arm":
            self._level_fingertips(along)
        twist[2] = -0.01
        for _ in range(round(0.0006 / 0.01 / model.TIMESTEP)):
            self._step_physics(twist)

    def _level_fingertips(self, along: Floats) -> None:
        """Turn toward the fingers that press less, pressing on, until all press."""
        twist, limit, tips = along.copy(), self.time() + 0.5, self.hand.tips(1.0)
        while self.time() < limit:
            forces = self.finger_forces()
            if forces.min() > 0.2 * TOUCH_N:
                return
            lower = (forces.mean() - forces) @ tips[:, :2]  # the side that has to come down
            twist[2] = 0.01
            twist[3:5] = np.array([lower[1], -lower[0]]) * (YIELD / max(1e-9, float(np.hypot(*lower))))
            self._step_physics(twist)

    def _close_fingers(self, along: Floats) -> None:
        still, last = 0.0, self._gap()
        while still < 0.1 and self.data.ctrl[self._grip] < MAX_OPENING / 2.0 + 0.02:
            self.data.ctrl[self._grip] += CLOSING_SPEED * model.TIMESTEP
            self._step_physics(along)
            stalled = abs(last - self._gap()) < 0.004 * model.TIMESTEP
            still, last = still + model.TIMESTEP if stalled else 0.0, self._gap()
        squeeze = float(self.data.qpos[self._finger[0]]) + 0.02
        self.data.ctrl[self._grip] = squeeze
        for _ in range(50):
            self._step_physics(along)
