# SPDX-License-Identifier: Apache-2.0
"""An image as it would look along a run that is drawn: the camera moves, the light changes, and the noise is another."""

from __future__ import annotations

import math
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack.images import Channel, Grey
from grasptrack.tracking.camera import Beforehand
from grasptrack.typing import Floats

TURN, TILT = 30.0, 30.0
"""Degrees, the most by which a run ends turned, and tilted about any axis."""
NEARER, FARTHER = 1.6, 0.85
"""Most and least growth of the object at the end of a run: it is approached."""
SHIFT = 1.0
"""Sizes of the object, the most by which it is shifted in the image."""
LIGHT = 0.15
"""Share, the most by which the light grows or falls."""
EXPOSED = 0.4
"""Share, the most of the time between two images for which the shutter is open."""
SHARP = 0.7
"""px; a shorter way while the shutter is open blurs nothing."""
_PATCHES = 5, 15
"""px, of the patches that are compared, and of the window in which they are."""
_FLOOR = 1.0 / 12.0
"""Variance that rounding to whole grey levels adds."""


def denoise_image(image: NDArray[np.uint8], noise: float) -> NDArray[np.uint8]:
    """An image without its noise, a standard deviation in grey levels: what comes after it must not share it (non-local means).

    Whatever is no stronger than the noise is smoothed away as well.
    """
    if image.ndim == 2:
        return np.asarray(cv2.fastNlMeansDenoising(image, None, noise, *_PATCHES), dtype=np.uint8)
    return np.asarray(cv2.fastNlMeansDenoisingColored(image, None, noise, noise, *_PATCHES), dtype=np.uint8)


class RunSetting(NamedTuple):
    """What a drawn run depends on.

    Attributes:
        centre: (2,) px, of the object in the first view.
        size: px, of it.
        reach: px from its centre to its farthest point.
        width, height: px, of the image.
        focal: what is known of the focal length.
    """

    centre: Floats
    size: float
    reach: float
    width: int
    height: int
    focal: Beforehand

    @property
    def image_centre(self) -> Floats:
        """(2,) px, of the image."""
        return 0.5 * np.array([self.width - 1.0, self.height - 1.0])


class RunImage(NamedTuple):
    """One image of a drawn run.

    Attributes:
        H: (3, 3) from the first view to this one.
        gain: by which grey levels are multiplied.
        smear: (2,) px that the object moves while the shutter is open.
    """

    H: Floats
    gain: float
    smear: Floats


REST = RunImage(np.eye(3), 1.0, np.zeros(2))
"""An image like the first view but for its noise."""


def draw_run(setting: RunSetting, count: int, rng: np.random.Generator) -> list[RunImage]:
    """A run of so many images after the first: a smooth way to a view that is drawn, in light and with a shutter of its own.

    The first view is taken as frontal; the camera is a pinhole of a focal length as it is known.
    """
    turn, tilt = math.radians(TURN) * rng.uniform(-1.0, 1.0), math.radians(TILT) * rng.uniform()
    about, growth = rng.uniform(-math.pi, math.pi), math.exp(rng.uniform(math.log(FARTHER), math.log(NEARER)))
    log, sd = float(setting.focal.theta[0]), math.sqrt(float(setting.focal.scale[0, 0]))
    f = setting.width * math.exp(log + sd * rng.standard_normal())
    room = np.maximum(setting.image_centre - growth * setting.reach, 0.0)  # in which it remains in view as a whole
    end = setting.image_centre + rng.uniform(-1.0, 1.0, 2) * room
    shift = end - setting.centre
    shift *= min(1.0, SHIFT * setting.size / max(float(np.hypot(*shift)), 1e-9))
    gain, exposed = 1.0 + LIGHT * rng.uniform(-1.0, 1.0), EXPOSED * rng.uniform()
    made, before = list[RunImage](), setting.centre
    for i in range(1, count + 1):
        u = 0.5 - 0.5 * math.cos(math.pi * i / count)
        rotation = np.array([tilt * u * math.cos(about), tilt * u * math.sin(about), turn * u])
        H = _motion_homography(setting, f, rotation, math.exp(u * math.log(growth)), shift * u)
        now = setting.centre + shift * u
        made.append(RunImage(H, 1.0 + (gain - 1.0) * u, exposed * (now - before)))
        before = now
    return made


def _motion_homography(setting: RunSetting, f: float, rotation: Floats, growth: float, shift: Floats) -> Floats:
    """(3, 3) how a pinhole of focal length f px sees a frontal plane that was turned, then tilted and brought nearer.

    The rotation, (3,) rad, is the tilt about an axis in the plane, and the turn.
    """
    R = cv2.Rodrigues(np.append(rotation[:2], 0.0))[0] @ cv2.Rodrigues(np.array([0.0, 0.0, rotation[2]]))[0]
    x, y = (setting.centre - setting.image_centre).tolist()
    X, Y = (setting.centre + shift - setting.image_centre).tolist()
    M = R @ np.diag([1.0, 1.0, f])  # of px (x, y, 1) about the middle
    M[:, 2] += np.array([X, Y, f]) / growth - R @ np.array([x, y, f])
    K, back = np.diag([f, f, 1.0]), np.eye(3)
    K[:2, 2], back[:2, 2] = setting.image_centre, -setting.image_centre
    H = K @ M @ back
    return np.asarray(H / H[2, 2], dtype=np.float64)


class Stage:
    """A first view that can be moved: freed of its noise, which would come along and pass for a surface of the scene.

    What comes into view goes on as the border was.

    It is (H, W) or BGR (H, W, 3); `channel` shows the object, and a pixel's standard deviation is `noise` grey levels.
    """

    def __init__(self, image: NDArray[np.uint8], channel: Channel, noise: float) -> None:
        self._source, self._channel = denoise_image(image, noise), channel
        self._rng = np.random.default_rng(0)
        drawn = math.sqrt(max(noise**2 - _FLOOR, 0.0)) * self._rng.standard_normal(image.shape, np.float32)
        self._noise = np.rint(drawn).astype(np.int16)

    def render_step(self, step: RunImage) -> NDArray[np.uint8]:
        """(H, W) or BGR (H, W, 3) the view as a step shows it, with fresh noise."""
        size = (self._source.shape[1], self._source.shape[0])
        border = cv2.BORDER_REPLICATE
        seen = cv2.warpPerspective(self._source, step.H, size, flags=cv2.INTER_CUBIC, borderMode=border)
        if float(np.hypot(*step.smear)) > SHARP:
            seen = cv2.filter2D(seen, -1, _blur_kernel(step.smear), borderType=border)
        if step.gain != 1.0:
            seen = cv2.convertScaleAbs(seen, alpha=step.gain)
        rows, columns = self._rng.integers(0, size[::-1]).tolist()  # the same noise elsewhere is fresh to every px
        noise = np.roll(self._noise, (rows, columns), axis=(0, 1))
        return np.asarray(cv2.add(seen, noise, dtype=cv2.CV_8U), dtype=np.uint8)

    def render_grey(self, step: RunImage) -> Grey:
        """(H, W) the same in the mixture of colours that shows the object."""
        return self._channel.to_grey(self.render_step(step))


def _blur_kernel(smear: Floats) -> Floats:
    """(n, n) kernel that spreads a pixel evenly along a way (2,) px about it."""
    half = math.ceil(0.5 * float(np.abs(smear).max())) + 1
    kernel = np.zeros((2 * half + 1, 2 * half + 1))
    for u in np.linspace(-0.5, 0.5, 4 * half + 1):
        (x, y), (i, j) = u * smear + half, np.floor(u * smear + half).astype(int).tolist()
        for k, share in ((0, 1.0 - (x - i)), (1, x - i)):
            kernel[j, i + k] += share * (1.0 - (y - j))
            kernel[j + 1, i + k] += share * (y - j)
    return np.asarray(kernel / kernel.sum(), dtype=np.float64)
