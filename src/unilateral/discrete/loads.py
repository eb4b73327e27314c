"""What a problem gives to the discrete one beside its data on the mesh: its form, and what a case knows."""

from __future__ import annotations

import math
from functools import partial

from unilateral.arrays import Array
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
    clamped = problem.clamped_sides
    c = problem.reaction
    known = 1.0 if c else math.inf
    C = friedrichs(mesh, clamped, known) if clamped else math.inf
    return Form(c=c, clamped=clamped, free=problem.free_sides, friedrichs=C)


def case_load(case: ExactSolution, mesh: Mesh) -> Array:
    """(n,) the load of a case's f, by quadrature."""
    return by_parts(mesh, partial(case_moments, case))


def obstacle_means(problem: Data, cells: Partition) -> Array:
    """(cells,) the means of g: of a case exact up to rounding, else of the enclosure."""
    if problem.exact:
        return cell_means(problem.exact, cells).g_means
    return problem.enclosed_obstacle.means(cells.points)
