"""What a problem gives to the discrete one beside its data on the mesh: its form, and what a case knows."""

from __future__ import annotations

from functools import partial

from unilateral.arrays import Array
from unilateral.errors import InputError
from unilateral.fem.form import Form
from unilateral.fem.p1 import by_parts, case_moments
from unilateral.fem.poincare import friedrichs
from unilateral.formulas.exact_numbers import rounded
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition
from unilateral.norms.exact_errors import cell_means
from unilateral.problems.case import ExactSolution
from unilateral.problems.problem import Problem


def form_of(problem: Problem, mesh: Mesh) -> Form:
    """The form of a problem. The mesh serves for the constant that it needs where a side is clamped."""
    form = Form(rounded(problem.k), rounded(problem.c), problem.clamped_sides, problem.free_sides)
    if not form.clamped:
        return form
    try:
        return form._replace(friedrichs=friedrichs(mesh, form.clamped))
    except InputError:
        if not form.c:
            raise
        return form


def case_load(case: ExactSolution, mesh: Mesh) -> Array:
    """(n,) the load of a case's f, by quadrature."""
    return by_parts(mesh, partial(case_moments, case))


def obstacle_means(problem: Problem, cells: Partition) -> Array:
    """(cells,) the means of g: of a case exact up to rounding, else of the enclosure."""
    if problem.exact:
        return cell_means(problem.exact, cells).g_means
    return problem.enclosed_obstacle.means(cells.points)
