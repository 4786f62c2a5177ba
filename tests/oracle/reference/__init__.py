# SPDX-License-Identifier: Apache-2.0
"""NumPy definition of every kernel: what the compiled ones must equal, told in plain arithmetic.

A module for each folder of `native/`, two where it has many kernels; its `__all__` names the kernels. What each takes,
gives and refuses is told in `src/_grasptrack_native.pyi`. They leave it to the compiled ones to refuse arrays of other types.
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
