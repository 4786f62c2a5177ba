# SPDX-License-Identifier: Apache-2.0
"""Pictures that lie on the table plane: photos, and what is made on the spot from a seed."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack.errors import InputError
from grasptrack.typing import Pixels

Floats32 = NDArray[np.float32]
Colour = tuple[float, float, float]


@dataclass(frozen=True)
class Texture:
    """A picture that lies on the table plane, mirrored at its borders where the view goes beyond it.

    Attributes:
        image: (H, W, 3) BGR or (H, W) grey.
        extent: table units from its middle to its left and right sides.
        middle: table units, where its middle lies; a part has its centroid at (0, 0).
    """

    image: Pixels
    extent: float
    middle: tuple[float, float] = (0.0, 0.0)

    @classmethod
    def from_image(cls, image: Pixels, extent: float = 4.5) -> Texture:
        """A photo seen from above as a table or a surface.

        Args:
            image: (H, W), (H, W, 3) BGR or (H, W, 4) with alpha, which is dropped; 8 bit.
            extent: table units from its middle to its left and right sides. Where the image is shorter than
                wide it is mirrored sooner below and above.

        Raises:
            InputError: not an 8-bit image.
        """
        picture = np.asarray(image)
        if picture.dtype != np.uint8 or picture.ndim not in (2, 3) or min(picture.shape[:2]) < 2:
            raise InputError(
                f"a texture is made from an 8-bit image (H, W) or (H, W, 3), not {picture.dtype} {picture.shape}",
                shape=picture.shape,
            )
        if picture.ndim == 3:
            picture = picture[..., 0] if picture.shape[2] < 3 else picture[..., :3]
        return cls(np.ascontiguousarray(picture), extent)

    @property
    def to_table(self) -> NDArray[np.float64]:
        """(3, 3) from its pixels to table coordinates."""
        height, width = self.image.shape[:2]
        scale = 2.0 * self.extent / width
        x, y = self.middle
        return np.array(
            [[scale, 0.0, x - 0.5 * (width - 1) * scale], [0.0, scale, y - 0.5 * (height - 1) * scale], [0.0, 0.0, 1.0]]
        )

    @property
    def grey(self) -> Texture:
        """The same without colour."""
        if self.image.ndim == 2:
            return self
        grey = np.asarray(cv2.cvtColor(self.image, cv2.COLOR_BGR2GRAY), dtype=np.uint8)
        return Texture(grey, self.extent, self.middle)

    @property
    def coloured(self) -> Texture:
        """The same with three channels."""
        if self.image.ndim == 3:
            return self
        return Texture(np.asarray(cv2.cvtColor(self.image, cv2.COLOR_GRAY2BGR), np.uint8), self.extent, self.middle)


def noise_field(rng: np.random.Generator, size: int, sx: float, sy: float) -> Floats32:
    """Noise of variance 1 with correlation lengths sx and sy px."""
    fx, fy = max(1, int(sx / 3.0)), max(1, int(sy / 3.0))  # slow waves are made small and enlarged
    noise = rng.standard_normal((-(-size // fy) + 1, -(-size // fx) + 1), dtype=np.float32)
    small = cv2.GaussianBlur(noise, (0, 0), sigmaX=sx / fx, sigmaY=sy / fy, borderType=cv2.BORDER_REFLECT_101)
    field = cv2.resize(small, (small.shape[1] * fx, small.shape[0] * fy), interpolation=cv2.INTER_CUBIC)[:size, :size]
    return np.asarray(field / field.std(), dtype=np.float32)


def tint_relief(value: Floats32, colour: Colour) -> Pixels:
    """Grey relief around 1 times a BGR colour."""
    return np.clip(np.rint(value[..., None] * np.array(colour, np.float32)), 0, 255).astype(np.uint8)
