# SPDX-License-Identifier: Apache-2.0
"""How exact contacts could be: the Cramer-Rao bound of scenes by the noise of their pixels, against the errors counted."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack.geometry.homographies import apply_homography
from grasptrack.tracking.follower import Follower
from grasptrack.tracking.target import Target
from grasptrack.typing import Floats
from grasptrack_bench.method import chosen_grasp, outline_of
from grasptrack_bench.scenes import SceneCase, ScenePart
from grasptrack_bench.simulation import SHAPES, Scene, SceneFrame
from research.studies import common

ROUNDING = 1.0 / 12.0
"""Grey levels^2, variance of whole numbers."""
EVERY = 3
"""Frames from one whose bound is worked out to the next."""


def by_pose(target: Target, G: Floats, points: Floats) -> Floats:
    """(n, 2, 8) px of the image by the pose's error, of work points (n, 2)."""
    (u, v), e = ((points - target.centre) / (target.size / 2.0)).T, 1e-4
    one, none = np.ones_like(u), np.zeros_like(u)
    rows = np.stack(
        [
            np.stack([one, none, u, v, none, none, u * u, u * v], axis=1),
            np.stack([none, one, none, none, u, v, u * v, v * v], axis=1),
        ],
        axis=1,
    )
    steps = [(apply_homography(G, points + d) - apply_homography(G, points - d)) / (2 * e) for d in np.eye(2) * e]
    return np.asarray(np.stack(steps, axis=2) @ rows)


def pose_information(target: Target, scene: Scene, index: int) -> Floats:
    """(8, 8) that the pixels of object and edge have of the pose's error in a frame."""
    light = np.asarray(scene.exposed_light(index), dtype=np.float64)
    grey = light if light.ndim == 2 else light[..., 0]
    grey = grey * (255.0 if grey.max() <= 2.0 else 1.0)
    mask = np.zeros(grey.shape, np.uint8)
    cv2.fillPoly(mask, [np.round(p).astype(np.int32) for p in scene[index].outline], (1,))
    y, x = np.nonzero(cv2.dilate(mask, np.ones((5, 5), np.uint8)))
    slopes = np.stack([np.gradient(grey, axis=1), np.gradient(grey, axis=0)], axis=-1)[y, x]
    G = scene.homography(index) @ target.A
    places = apply_homography(np.linalg.inv(G), np.column_stack([x, y]).astype(np.float64))
    rows = np.einsum("ni,nik->nk", slopes, by_pose(target, G, places))
    return np.asarray(rows.T @ rows / (scene.conditions.noise**2 + ROUNDING))


def pinhole_rows(target: Target, G: Floats, scene: Scene) -> Floats:
    """(2, 8) how a pose's error makes axes of a plane that was first seen frontally no longer square, and unlike in length."""
    ray, step = np.linalg.inv(scene.camera.matrix), 0.1

    def axes(d: Floats) -> Floats:
        a, b = (ray @ target.handle.moved(G, d) @ np.linalg.inv(target.A))[:, :2].T
        return np.array([a @ b / math.sqrt((a @ a) * (b @ b)), 0.5 * math.log((a @ a) / (b @ b))])

    return np.column_stack([axes(d) - axes(0.0 * d) for d in step * np.eye(8)]) / step


def error_bounds(target: Target, scene: Scene) -> tuple[float, float]:
    """px, the least rms error of a contact: of any homography, and of a pinhole's views of a plane whose camera is known."""
    first, found = np.linalg.inv(pose_information(target, scene, 0)), []
    for index in range(EVERY, len(scene), EVERY):
        G = scene.homography(index) @ target.A
        free = np.linalg.inv(pose_information(target, scene, index)) + first
        rows = pinhole_rows(target, G, scene)
        held = free - free @ rows.T @ np.linalg.inv(rows @ free @ rows.T) @ rows @ free
        J = by_pose(target, G, target.work_contacts)
        found.append([np.mean([np.trace(j @ C @ j.T) for j in J]) for C in (free, held)])
    free_rms, held_rms = np.sqrt(np.mean(found, axis=0)).tolist()
    return free_rms, held_rms


def tracking_error(frames: list[SceneFrame], first: NDArray[np.uint8], contacts: Floats) -> tuple[Target, float]:
    """The target, and px, rms of its contacts in all frames that were answered after a first image."""
    follower = Follower(first, outline_of(frames[0].outline), contacts, 0.0)
    found = [(follower.update(f.image, f.time), f) for f in frames[1:]]
    off = [d.estimate.contacts - f.carry(contacts) for d, f in found if d.is_accepted and d.estimate is not None]
    return follower.target, float(np.sqrt((np.array(off) ** 2).sum(axis=2).mean())) if off else math.nan


def main() -> None:
    """Run and print."""
    parser = common.create_parser(
        __doc__,
        shapes="bracket,half-disc,bottle,key,gear,s-blob",
        disturbances="clean-4dof,clean-6dof,still,noise,blur",
        frames=40,
        seed=702,
    )
    asked = parser.parse_args()
    common.begin_section("How exact it could be")
    common.add_paragraph("px, rms of a contact. The last column is of the same first view without its noise.")
    rows: list[tuple[object, ...]] = []
    for disturbance in asked.disturbances.split(","):
        told = []
        for name in asked.shapes.split(","):
            scene = SceneCase(ScenePart(SHAPES[name]()), disturbance, frames=asked.frames, seed=asked.seed).scene()
            frames, noise = list(scene), scene.conditions.noise
            contacts = chosen_grasp(frames[0].outline)
            target, off = tracking_error(frames, frames[0].image, contacts)
            without = tracking_error(frames, scene.with_conditions(noise=0.0)[0].image, contacts)[1]
            told.append((*error_bounds(target, scene), off, without))
            free, held, *_ = told[-1]
            rows.append((disturbance, name, noise, free, held, off, off / free, without))
        free, held, off, without = np.sqrt(np.mean(np.square(told), axis=0)).tolist()
        rows.append((disturbance, "all", math.nan, free, held, off, off / free, without))
    head = (
        "scene", "part", "noise", "bound", "bound, known pinhole", "counted", "times the bound",
        "noise-free first view",
    )  # fmt: skip
    common.add_table(head, rows)
    common.write_sections(asked.output)


if __name__ == "__main__":
    main()
