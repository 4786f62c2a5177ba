# SPDX-License-Identifier: Apache-2.0
"""NumPy definition of every kernel: what the compiled ones must equal, told in plain arithmetic.

A module for each folder of `native/`, two where it has many kernels; its `__all__` names the kernels. They take arrays of the
types and shapes that their annotations say, and leave it to the compiled ones to refuse others.

Throughout, `points` is float64 (N, 2) px, a concatenation of closed contours whose first point is not repeated, and
`offsets` int64 (C + 1,) says that contour c is ``points[offsets[c]:offsets[c + 1]]``. With t = (tx, ty) the tangent
along a contour's direction, (ty, -tx) points out of the material and (-ty, tx) into it, for outer contours and holes. A
position on a contour of n points is a vertex index plus the fraction of the segment that follows, in [0, n).
"""

from reference import crossing, geometry, grasp, homography, image, matching, registration, synthesis, transfer
from reference.crossing import *
from reference.geometry import *
from reference.grasp import *
from reference.homography import *
from reference.image import *
from reference.matching import *
from reference.registration import *
from reference.synthesis import *
from reference.transfer import *

_parts = crossing, geometry, grasp, homography, image, matching, registration, synthesis, transfer
__all__ = [name for part in _parts for name in part.__all__]
