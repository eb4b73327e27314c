"""Discrete problems whose solution is known, whatever the mesh: what extremes are judged by.

u_h = p is linear and lambda_H >= 0 any: with (f, v) := (p, v)_1 - <lambda_H, v> and cell means of g that
leave a gap only where lambda_H is 0, (p, lambda_H) solves the discrete problem. The load is made without the
stiffness matrix, from the mass matrix and the flux of p.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from unilateral.arrays import Array
from unilateral.discrete.condensed import CondensedProblem, build_condensed_problem
from unilateral.fem.condense import CondensedMatrix, condense
from unilateral.fem.p1 import stiffness_and_mass
from unilateral.fem.spaces import MixedSpaces, mixed_spaces
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition, make_uniform_partition
from unilateral.geometry.polygon import square
from unilateral.geometry.structured import make_structured_mesh

N_CONTACT_INTERVALS = 3
MIN_ROUNDING = 1e-12
"""`rounding` is at least this, a round number above the rounding of a few hundred operations."""
ContactRule = Callable[[Partition], tuple[Array, Array]]
"""A function that gives lambda_H and the gap, (m,) each, of a partition."""


@dataclass(frozen=True, eq=False)
class ExtremeProblem:
    """The discrete problem that the library gets, and its solution u (n,), lambda_H (m,).

    `size` is ||lambda_H||_{-1/2,h}, the error of the multiplier 0.
    """

    discrete: CondensedProblem
    u: Array
    lambda_H: Array
    size: float

    @property
    def spaces(self) -> MixedSpaces:
        """The spaces of the discrete problem."""
        return self.discrete.spaces

    @property
    def condition(self) -> float:
        """lambda_max(S) / lambda_min(S), infinite where S is singular."""
        operator = self.spaces.operator
        return np.inf if operator.is_singular else operator.lambda_max / operator.lambda_min

    @cached_property
    def rounding(self) -> float:
        """Relative change of constants by rounding, ||A^{-1} (1, .)_0 - 1||_1 / ||1||_1 as computed."""
        mesh = self.spaces.mesh
        constant = np.ones(mesh.n_nodes)
        computed = self.spaces.condensed.solve(stiffness_and_mass(mesh)[1] @ constant)
        return max(MIN_ROUNDING, self.norm(computed - constant) / self.norm(constant))

    @property
    def rounding_allowance(self) -> float:
        """Error that rounding may add to u(mu), and to the multiplier by way of A^{-1} f.

        ||A^{-1} f||_1 <= ||u_h||_1 + ||lambda_H||_{-1/2,h}; both are taken to lose what constants lose.
        """
        return 2 * self.rounding * self.norm(self.u) + self.rounding * self.size

    def error(self, mu: Array) -> float:
        """||u(mu) - u_h||_1 of any multiplier (m,), by a solve on all nodes, in units of a power of 2."""
        # A power of 2 near the largest value: dividing by it rounds nothing, and squares stay in range
        unit = 2.0 ** (math.frexp(float(np.abs(self.u).max()))[1] - 1)
        u = self.spaces.response(self.discrete.load / unit, mu / unit)
        return unit * self.norm(u - self.u / unit)

    def distance(self, mu: Array, reference: Array) -> float:
        """How far a multiplier (m,) is from another one, in L2, relative to the latter."""
        H_i = self.spaces.operator.H_i
        return float(np.sqrt(H_i @ (mu - reference) ** 2 / (H_i @ reference**2)))

    def norm(self, v: Array) -> float:
        """||v||_1 of v (n,), scaled: the square of a tiny number would be 0."""
        unit = float(np.abs(v).max())
        if not 0 < unit < np.inf:
            return unit
        return unit * float(np.sqrt(max(v / unit @ (self.spaces.condensed.A @ (v / unit)), 0.0)))


def pose_solution(
    mesh: Mesh, partition: Partition, lambda_H: Array, gap: Array, factor: float = 1.0
) -> ExtremeProblem:
    """The problem with these lambda_H and cell means of u - g, both (m,); all data multiplied by `factor`.

    lambda_H is measured in units of |Omega| / |boundary|, with which u(1) is about 1.
    """
    polygon = mesh.polygon
    spaces = mixed_spaces(condense_mesh(mesh), partition)
    lambda_H = factor * polygon.area / polygon.perimeter * lambda_H
    slope = factor * min(1.0, 1 / polygon.diameter)
    u = factor + slope * (mesh.points - polygon.vertices[0]).sum(axis=1)
    # (f, phi_j) = (u, phi_j)_0 + <du/dn, phi_j> - <lambda_H, phi_j>, as u is linear
    load = stiffness_and_mass(mesh)[1] @ u
    # Half of the flux on each edge goes to either end
    half = 0.5 * np.diff(mesh.s) * slope * polygon.normals.sum(axis=1)[mesh.side]
    load[mesh.boundary] += half + np.roll(half, 1) - spaces.B.T @ lambda_H
    # g has the cell means of u - gap, so that complementarity holds cell by cell
    means = spaces.B @ u[mesh.boundary] / partition.lengths
    discrete = build_condensed_problem(
        spaces, load, spaces.condensed.solve(load)[mesh.boundary], means - factor * gap
    )
    unit = float(lambda_H.max()) or 1.0
    size = unit * float(np.linalg.norm(spaces.operator.D_factor @ (lambda_H / unit)))
    return ExtremeProblem(discrete, u, lambda_H, size)


def pose_contact(
    mesh: Mesh, partition: Partition, contact: ContactRule, factor: float = 1.0
) -> ExtremeProblem:
    """The problem with that contact."""
    return pose_solution(mesh, partition, *contact(partition), factor)


def pose_on_square(h: float, H: float, contact: ContactRule, factor: float = 1.0) -> ExtremeProblem:
    """The problem with that contact on a structured mesh of the unit square and a uniform partition."""
    return pose_contact(structured_square(h), make_uniform_partition(square(), H), contact, factor)


@lru_cache(maxsize=1)
def structured_square(h: float) -> Mesh:
    """The structured mesh of the unit square; the points of most axes share one."""
    return make_structured_mesh(square(), h)


@lru_cache(maxsize=1)
def condense_mesh(mesh: Mesh) -> CondensedMatrix:
    """The mesh, condensed; the last one is kept for the axis's next point."""
    return condense(mesh)


def cell_middles(partition: Partition) -> Array:
    """Middles of the cells (m,) as shares of the perimeter."""
    return 0.5 * (partition.points[1:] + partition.points[:-1]) / partition.polygon.perimeter


def wave_contact(partition: Partition) -> tuple[Array, Array]:
    """lambda_H and the gap, (m,) each, with contact on three intervals."""
    wave = np.sin(2 * np.pi * N_CONTACT_INTERVALS * cell_middles(partition))
    return np.maximum(wave, 0), np.maximum(-wave, 0)


def full_contact(partition: Partition) -> tuple[Array, Array]:
    """lambda_H and the gap, (m,) each, with contact everywhere."""
    return 1 + 0.5 * np.sin(2 * np.pi * N_CONTACT_INTERVALS * cell_middles(partition)), np.zeros(
        partition.n_cells
    )
