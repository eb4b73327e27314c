"""What a problem gives to the discrete one beside its data on the mesh: its form, and what a case knows."""

from __future__ import annotations

import math
from functools import partial

from unilateral.arrays import Array
from unilateral.errors import InputError
from unilateral.fem.form import Form
from unilateral.fem.p1 import by_parts, case_moments
from unilateral.fem.poincare import friedrichs
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition
from unilateral.norms.exact_errors import cell_means
from unilateral.problems.case import ExactSolution
from unilateral.problems.scaled import Data


def form_of(problem: Data, mesh: Mesh) -> Form:
    """The form of a problem. The mesh serves for the constant that it needs where a side is clamped."""
    clamped, reaction = problem.clamped_sides, problem.reaction
    constant = 1.0 if reaction else math.inf
    if clamped:
        try:
            constant = min(constant, friedrichs(mesh, clamped))
        except InputError:
            if not reaction:
                raise
    return Form(reaction, clamped, constant, problem.free_sides)


def case_load(case: ExactSolution, mesh: Mesh) -> Array:
    """(n,) the load of a case's f, by quadrature."""
    return by_parts(mesh, partial(case_moments, case))


def obstacle_means(problem: Data, cells: Partition) -> Array:
    """(cells,) the means of g: of a case exact up to rounding, else of the enclosure."""
    if problem.exact:
        return cell_means(problem.exact, cells).g_means
    return problem.enclosed_obstacle.means(cells.points)
