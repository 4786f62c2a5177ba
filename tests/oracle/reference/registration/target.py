# SPDX-License-Identifier: Apache-2.0
"""What was chosen in the reference view, and the eight parameters by which a pose of it may be off."""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from grasptrack.typing import Floats
from reference.registration.pyramid import inverse_homography

INNER = 6
"""Grey levels of an edge's inner side that are kept, ..."""
INNER_FIRST = -7
"""... from so many px inside (negative) outward."""


class Patches(NamedTuple):
    """Texture of one look."""

    stride: float  # work px between two pixels of a patch
    places: Floats  # (m, 2) work px, their middles
    value: Floats  # (m, 49) grey levels less their mean
    gradients: Floats  # (m, 2, 49) per work px, less what a gain or a bias of the light would change as well
    axes: Floats  # (2, m, 2) unit, along which the gradients are least and largest
    power: Floats  # (2, m) sums of their squares along these
    rows: Floats  # (m, 2, 8) derivatives of the shift that each tells by the pose's error: by the places of all its pixels


def bent(bend: Floats, J: Floats) -> Floats:
    """(n, 2) work px by which places lie beside where the pose alone has them, for a readout of 1.

    Args:
        bend: (3, 8) b: by J (b0 + b1 u + b2 v) at (u, v), taken from the centre in units of the radius.
        J: (n, 2, 8) derivatives of the places by the pose's error; or of the shifts that patches tell, which have the u and v
            of their pixels, as far as they tell, in them.
    """
    none, by_u, by_v = (J @ b for b in bend)
    along = J[:, :, (2, 4)] @ by_u[:, :, None] + J[:, :, (3, 5)] @ by_v[:, :, None]
    return np.asarray(none + along[:, :, 0])


@dataclass
class Target:
    """What is looked for.

    All places are in work px: the reference view, cut out and reduced. A pose G carries them to px of an image. Its error
    d (8,) is in work px: by it a place (u, v), taken from the centre in units of the radius, moves by
    (d0 + d2 u + d3 v + d6 u^2 + d7 u v, d1 + d4 u + d5 v + d6 u v + d7 v^2), to first order.

    Attributes:
        A: (3, 3) work px to px of the reference image.
        centre, radius: (2,), work px.
        noise: grey levels, of the camera.
        half: work px on each side of an edge that were averaged for `contrast`.
        normal_noise: (n,) rad, by which noise may turn each normal.
        points, normals: (n, 2) samples of the outline, (n, 2) unit, outward.
        contrast: (n,) signed steps there, grey levels.
        inner: (n, INNER) grey levels inside each.
        surface, surface_value: (s, 2) where gain and bias of the light are measured, (s,) grey levels there.
        contacts: (k, 2).
        depth: (REGION_CELLS,) work px from the outline.
        inside: (n, REGION_CELLS) grey levels that deep inside; NaN where there is no material.
        outside: (n, REGION_CELLS) above 0 where that far outside is outside.
        texture: fine to coarse.
        rows: (n, 8) derivatives of a sample's offset along its normal by the pose's error.
        along: (n, 8) the same of its shift along the outline.
    """

    A: Floats
    centre: Floats
    radius: float
    noise: float
    half: float
    normal_noise: Floats
    points: Floats
    normals: Floats
    contrast: Floats
    inner: Floats
    surface: Floats
    surface_value: Floats
    contacts: Floats
    depth: Floats
    inside: Floats
    outside: Floats
    texture: list[Patches] = field(default_factory=list)

    def __post_init__(self) -> None:
        J = self.jacobian(self.points)
        self.rows = self.normals[:, :1] * J[:, 0] + self.normals[:, 1:] * J[:, 1]
        self.along = self.normals[:, :1] * J[:, 1] - self.normals[:, 1:] * J[:, 0]

    def jacobian(self, points: Floats) -> Floats:
        """(n, 2, 8) derivatives of the places of points (n, 2) by the pose's error."""
        u, v = (points[:, 0] - self.centre[0]) / self.radius, (points[:, 1] - self.centre[1]) / self.radius
        one, zero = np.ones(len(points)), np.zeros(len(points))
        x = np.stack([one, zero, u, v, zero, zero, u * u, u * v], axis=1)
        y = np.stack([zero, one, zero, zero, u, v, u * v, v * v], axis=1)
        return np.stack([x, y], axis=1)

    def _normalizing_transforms(self) -> tuple[Floats, Floats]:
        """Work px to units of the radius about the centre, and back, (3, 3) each."""
        r, (cx, cy) = self.radius, self.centre
        there = np.array([[1.0 / r, 0.0, -cx / r], [0.0, 1.0 / r, -cy / r], [0.0, 0.0, 1.0]])
        return there, np.array([[r, 0.0, cx], [0.0, r, cy], [0.0, 0.0, 1.0]])

    def moved(self, G: Floats, d: Floats) -> Floats:
        """The pose (3, 3) that G is once its error d (8,) is made good."""
        there, back = self._normalizing_transforms()
        e = d / self.radius
        D = np.array([[1.0 + e[2], e[3], e[0]], [e[4], 1.0 + e[5], e[1]], [-e[6], -e[7], 1.0]])
        H = (G @ back) @ (D @ there)
        return np.asarray(H * (1.0 / H[2, 2]))

    def difference(self, G0: Floats, G: Floats) -> Floats | None:
        """The d (8,) by which `moved` leads from G0 to G; None where there is none."""
        inverse = inverse_homography(G0)
        if inverse is None:
            return None
        there, back = self._normalizing_transforms()
        D = (there @ (inverse @ G)) @ back
        if not abs(D[2, 2]) > 1e-12:
            return None
        D = D * (1.0 / D[2, 2])
        d = self.radius * np.array(
            [D[0, 2], D[1, 2], D[0, 0] - 1.0, D[0, 1], D[1, 0], D[1, 1] - 1.0, -D[2, 0], -D[2, 1]]
        )
        return d if np.isfinite(d).all() else None
