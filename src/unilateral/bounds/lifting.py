"""What makes a function of P2 feasible on the boundary; (u_h, lambda_H) says where there is contact."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from unilateral.arrays import Array, Mask
from unilateral.bounds.constraint import Constraint, constraint
from unilateral.bounds.edge_flux import EdgeFlux, in_contact
from unilateral.bounds.feasible_p2 import Missing, missing, raised
from unilateral.fem.p2 import Layer, layer
from unilateral.geometry.mesh import Mesh
from unilateral.problems.obstacle import Obstacle


class Lifting(NamedTuple):
    """The layer, the constraint, P2's unknowns in `contact` (2 nb,), and the flux (nb, 2) at edges' ends."""

    of: Layer
    g: Constraint
    contact: Mask
    flux: Array

    def met(self, nodal: Array) -> tuple[Array, Array]:
        """(nb,), (nb,) the hats and bubbles to add to values at boundary nodes, to be g in contact."""
        before = _trace(nodal, np.zeros_like(nodal))
        return _coefficients(np.where(self.contact, self.g.at_unknowns - before, 0.0))

    def lifted(self, nodal: Array, bubbles: Array) -> tuple[Array, Array, Missing]:
        """(nb,), (nb,) what to add to these coefficients to make them feasible, and what is missing then."""
        before, triangle = _trace(nodal, bubbles), self.of.mesh.boundary_triangles
        v, touching = raised(self.g, before, self.contact, triangle, self.flux, self.of.bubble_squares())
        return *_coefficients(v - before), missing(self.g, v, touching, triangle, self.flux)

    def added(self, short: Missing) -> Array:
        """(k,) the squared norms of what is added for the doubt on the layer's triangles."""
        nodal = short.added[self.of.mesh.boundary]
        return self.of.norms(*self.of.function(nodal, np.zeros_like(nodal)))


def lifting(mesh: Mesh, obstacle: Obstacle, u_h: Array, flux: EdgeFlux, held: Mask) -> Lifting:
    """The lifting for u_h (n,), with g on the edges `held` (nb,)."""
    nb = len(held)
    start = np.arange(nb)
    unknowns = np.column_stack([start, (start + 1) % nb, nb + start])
    g = constraint(obstacle, mesh, unknowns, 2 * nb, held)
    contact = in_contact(g, _trace(u_h[mesh.boundary], np.zeros(nb)), flux.push)
    return Lifting(layer(mesh), g, contact, flux.ends)


def _trace(nodal: Array, bubbles: Array) -> Array:
    """(2 nb,) values at the boundary nodes, then at the midpoints of the edges."""
    return np.concatenate([nodal, 0.5 * (nodal + np.roll(nodal, -1)) + bubbles])


def _coefficients(trace: Array) -> tuple[Array, Array]:
    """(nb,), (nb,) the coefficients of hats and of bubbles with that trace (2 nb,)."""
    nodal, middle = np.split(trace, 2)
    return nodal, middle - 0.5 * (nodal + np.roll(nodal, -1))
