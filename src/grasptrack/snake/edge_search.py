# SPDX-License-Identifier: Apache-2.0
"""Edges of an image along the normals of a snake's curve (Blake and Isard, Active Contours, ch. 5)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from grasptrack import kernels
from grasptrack.kernels.reference.homography import displacement_fields
from grasptrack.snake.shape_space import ShapeSpace
from grasptrack.snake.template import Grey, Template
from grasptrack.typing import Bools, Floats

FAINTEST = 0.2
"""Share of the template's strength, and of its contrast doubled, that an edge must have: motion blur takes the rest."""


class Rows(NamedTuple):
    """A curve and the linear measurement along its normals.

    Attributes:
        points: (m, 2) px; normals: (m, 2) unit.
        A: (m, dof), n^T W: px along the normal per unit of the state.
        edges: (m, 4) of the edge search.
        gap: (m,) px from the curve to the edge along the normal, the template's own bias taken off; 0 where not used.
        used: (m,) an edge of the right kind was found.
    """

    points: Floats
    normals: Floats
    A: Floats
    edges: Floats
    gap: Floats
    used: Bools


def displacement_columns(M: Floats, local: Floats) -> Floats:
    """(m, 2, 8): how the 8 parameters of a homography move the points of a view, all in px.

    Translation, scale and rotation, then the two shears of an affine map, then the two bends of perspective.

    Args:
        M: (2, 2) linear part of the view.
        local: (m, 2) template points about the centroid, in units of rho.
    """
    return np.asarray(M @ displacement_fields(local))


class Model:
    """What stays the same from image to image, computed once.

    Args:
        template: the samples to search for; space: the shape space of the whole outline.

    Attributes:
        local: (m, 2) the searched points about the space's centre, in units of rho.
        W: (2, m, dof) how a state moves them along x and y.
        field: (2, m, 8) how a homography's parameters do, in the template's own frame; see `displacement_columns`.
    """

    def __init__(self, template: Template, space: ShapeSpace) -> None:
        self.template = template
        self.space = space
        self.local: Floats = space.local[template.chosen]
        self.W: Floats = np.ascontiguousarray(space.jacobian(template.points).transpose(1, 0, 2))
        self.field: Floats = np.ascontiguousarray(displacement_columns(np.eye(2), self.local).transpose(1, 0, 2))


def search_along_normals(model: Model, state: Floats, image: Grey, reach: float) -> Rows:
    """Edges along the normals of the curve at a state.

    Args:
        model: what to search for.
        state: (dof,) px.
        image: (H, W) grey.
        reach: px on either side.
    """
    template, space, local = model.template, model.space, model.local
    M = space.linear(state)
    points = local @ (space.rho * M.T)
    points += space.centre + state[:2]
    (a, b), (c, d) = M.tolist()
    normals = template.normals @ np.array(((d, -b), (-c, a)))  # the cofactors carry normals
    length = np.sqrt(np.einsum("ij,ij->i", normals, normals))
    normals /= length[:, None]
    edges = kernels.search_along_normals(image, points, normals, reach, template.polarity)
    gap = edges[:, 0] - template.bias * ((a * d - b * c) / length)
    used = edges[:, 1] * template.sign >= FAINTEST * template.strength
    gap[~used] = 0.0
    A = normals[:, :1] * model.W[0]
    A += normals[:, 1:] * model.W[1]
    return Rows(points, normals, A, edges, gap, used)
