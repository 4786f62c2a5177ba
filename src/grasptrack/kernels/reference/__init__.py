# SPDX-License-Identifier: Apache-2.0
"""NumPy definition of every kernel: what the compiled ones must equal, and what runs where nothing was compiled.

A module for each folder of `native/`, two where it has many kernels; its `__all__` names the kernels.

Throughout, `points` is float64 (N, 2) px, a concatenation of closed contours whose first point is not repeated, and
`offsets` int64 (C + 1,) says that contour c is ``points[offsets[c]:offsets[c + 1]]``. With t = (tx, ty) the tangent
along a contour's direction, (ty, -tx) points out of the material and (-ty, tx) into it, for outer contours and holes. A
position on a contour of n points is a vertex index plus the fraction of the segment that follows, in [0, n).
"""

from typing import TYPE_CHECKING

from grasptrack.kernels.reference import (
    crossing,
    geometry,
    grasp,
    homography,
    image,
    matching,
    registration,
    synthesis,
    transfer,
)
from grasptrack.kernels.reference.arguments import typed
from grasptrack.kernels.reference.crossing import *  # noqa: F403
from grasptrack.kernels.reference.geometry import *  # noqa: F403
from grasptrack.kernels.reference.grasp import *  # noqa: F403
from grasptrack.kernels.reference.homography import *  # noqa: F403
from grasptrack.kernels.reference.image import *  # noqa: F403
from grasptrack.kernels.reference.matching import *  # noqa: F403
from grasptrack.kernels.reference.registration import *  # noqa: F403
from grasptrack.kernels.reference.synthesis import *  # noqa: F403
from grasptrack.kernels.reference.transfer import *  # noqa: F403

if not TYPE_CHECKING:  # who checks types follows the imports
    _parts = crossing, geometry, grasp, homography, image, matching, registration, synthesis, transfer
    __all__ = [name for part in _parts for name in part.__all__]
    # among themselves the definitions call each other as they are
    globals().update({name: typed(globals()[name]) for name in __all__ if name != "PoseTarget"})
