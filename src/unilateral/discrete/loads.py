"""What a problem gives to the discrete one: the loads of f and q, and the means of g."""

from __future__ import annotations

import math
from functools import partial
from typing import NamedTuple

import numpy as np

from unilateral.arrays import Array
from unilateral.bounds.boundary_flux import Given, given
from unilateral.bounds.source import Source, source_of
from unilateral.fem.form import Form
from unilateral.fem.p1 import by_parts, case_moments, edge_load
from unilateral.fem.poincare import friedrichs
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition
from unilateral.norms.exact_errors import cell_means
from unilateral.problems.scaled import Data


def form_of(problem: Data, mesh: Mesh) -> Form:
    """The form of a problem. The mesh serves for the constant that it needs where a side is clamped."""
    clamped, reaction = problem.clamped_sides, problem.reaction
    known = 1.0 if reaction else math.inf
    C = friedrichs(mesh, clamped, known) if clamped else known
    return Form(reaction, clamped, C, problem.free_sides)


def held_values(problem: Data, mesh: Mesh) -> Array:
    """(n,) what u_h is held at: the values of u that are given on clamped sides, at nodes there, and 0."""
    values, nodes = np.zeros(mesh.n_nodes), np.append(mesh.boundary, mesh.boundary[0])
    edge = np.flatnonzero(np.isin(mesh.side, problem.clamped_sides))
    for end in (1, 0) if edge.size else ():
        values[nodes[edge + end]] = problem.enclosed_obstacle.on_edges(mesh.s)[edge, end]
    return values


class Load(NamedTuple):
    """(n,) the values (f, phi_i), and the enclosure of f if they are made of that."""

    values: Array
    source: Source | None


def load_of(problem: Data, mesh: Mesh) -> Load:
    """The load of f: of a case by quadrature, else that of its enclosure's polynomials."""
    if problem.exact:
        return Load(by_parts(mesh, partial(case_moments, problem.exact)), None)
    source = source_of(mesh, problem)
    return Load(source.load, source)


def obstacle_means(problem: Data, cells: Partition) -> Array:
    """(cells,) the means of g: of a case exact up to rounding, else of the enclosure."""
    if problem.exact:
        return cell_means(problem.exact, cells).g_means
    return problem.enclosed_obstacle.means(cells.points)


class BoundaryData(NamedTuple):
    """The given flux `tau`, the means (cells,) of g, and what u_h is held at (n,) on clamped sides."""

    tau: Given
    g_means: Array
    held: Array

    def load(self, mesh: Mesh) -> Array:
        """(n,) the load of the flux, exact for the polynomials of its enclosure."""
        return edge_load(mesh, self.tau.ends)


def boundary_data(problem: Data, mesh: Mesh, cells: Partition, form: Form) -> BoundaryData:
    """What a problem gives on the boundary of a mesh; the bounds take the same `tau`."""
    return BoundaryData(
        tau=given(problem.enclosed_flux, mesh, form),
        g_means=obstacle_means(problem, cells),
        held=held_values(problem, mesh),
    )
