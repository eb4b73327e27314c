"""What a problem gives to the discrete one beside its data on the mesh: its form, and what a case knows."""

from __future__ import annotations

from functools import partial

from unilateral.arrays import Array
from unilateral.errors import InputError
from unilateral.fem.form import Form
from unilateral.fem.p1 import assemble_load_by_blocks, case_moments
from unilateral.fem.poincare import friedrichs_constant
from unilateral.formulas.exact_numbers import as_float
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition
from unilateral.norms.exact_errors import cell_means
from unilateral.problems.case import ExactSolution
from unilateral.problems.problem import Problem

NEGLIGIBLE_FRIEDRICHS_RATIO = 100.0
"""Where c C^2 > k times this, C would lower the bound c^{-1/2} on ||v||_0 / ||v|| by less than 0.5 %."""


def problem_form(problem: Problem, mesh: Mesh) -> Form:
    """The form of a problem, with Friedrichs' constant by the mesh where a side is clamped.

    Raises InputError if c = 0 and no constant is found.
    """
    form = Form(as_float(problem.k), as_float(problem.c), problem.clamped_sides, problem.free_sides)
    # C is at least the inradius over 2.405, the first zero of J_0, and that at least this length
    length = mesh.polygon.area / mesh.polygon.perimeter / 2.405
    if not form.clamped or form.c * length**2 > NEGLIGIBLE_FRIEDRICHS_RATIO * form.k:
        return form
    try:
        return form._replace(friedrichs=friedrichs_constant(mesh, form.clamped))
    except InputError:
        if form.c > 0:
            return form
        raise


def case_load(case: ExactSolution, mesh: Mesh) -> Array:
    """The load of a case's source, by quadrature; shape (n,)."""
    return assemble_load_by_blocks(mesh, partial(case_moments, case))


def obstacle_means(problem: Problem, cells: Partition) -> Array:
    """The means (cells,) of g over the cells: of a case exact up to rounding, else of the enclosure."""
    if problem.exact:
        return cell_means(problem.exact, cells).g_means
    return problem.enclosed_obstacle.means(cells.points)
