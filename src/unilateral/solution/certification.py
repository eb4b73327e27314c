"""Bounds on the errors of a function that another program computed.

They hold for any u of V_h. To be sharp they need a multiplier and a flux in equilibrium with it: this
project's own on the same mesh, or those of the linear problem with a given multiplier as the flux.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from unilateral.arrays import MAX_INPUT_VALUE, Array, Mask, read_floats, read_nodal_values
from unilateral.discrete.choice import condensed_spaces, solve_on_mesh
from unilateral.discrete.condensed import discretise_on_condensed_spaces
from unilateral.discrete.problem_data import problem_form
from unilateral.discrete.solution import DiscreteSolution
from unilateral.errors import InputError
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition
from unilateral.problems.build import put_on_mesh
from unilateral.solution.solution import Solution
from unilateral.solvers.stop import Stop
from unilateral.solvers.uzawa import DualResult

if TYPE_CHECKING:
    from unilateral.problems.problem import Problem


def certify_nodal_values(
    problem: Problem, mesh: Mesh, u: ArrayLike, multiplier: ArrayLike | None
) -> Solution:
    """Solution with a user's values `u` (n,) at nodes and `multiplier` (nb,) on boundary edges, if given.

    Theorem 8 takes any v >= g, so u with a lift will do; lambda_H and the flux come from a problem that is
    solved here. Raises InputError for values that do not fit the mesh.
    """
    problem = put_on_mesh(problem, mesh)
    values = read_nodal_values(u, "u")
    place = "node (of a second-order function: each corner of a triangle)"
    _check_finite_values(values, mesh.n_nodes, "u", place)
    if multiplier is None:
        # the bounds hold for any lambda_H >= 0; two edges a cell keep its error small (Theorem 5)
        discrete_solution = solve_on_mesh(problem, mesh, pair_boundary_edges(mesh), Stop())
    else:
        no_contact = np.isin(mesh.side, (*problem.free_sides, *problem.clamped_sides))
        discrete_solution = _solve_linear(problem, mesh, _check_edge_multiplier(multiplier, no_contact))
    # the discrete u_h, of which the flux is made, becomes the potential
    foreign_solution = replace(discrete_solution, u_h=values, potential=discrete_solution.u_h)
    return Solution(problem, foreign_solution)


def pair_boundary_edges(mesh: Mesh) -> Partition:
    """Partition with cells of two boundary edges; the last one of a side has three if their number is odd."""
    sides = np.split(mesh.s[:-1], np.flatnonzero(np.diff(mesh.side)) + 1)
    cell_starts = [nodes[: max(len(nodes) // 2 * 2, 1) : 2] for nodes in sides]
    return Partition(mesh.polygon, np.append(np.concatenate(cell_starts), mesh.s[-1]))


def _solve_linear(problem: Problem, mesh: Mesh, lambda_H: Array) -> DiscreteSolution:
    """Discrete solution of the linear problem with the flux `lambda_H` (nb,) on sides with contact."""
    partition = Partition(mesh.polygon, mesh.s)
    spaces = condensed_spaces(mesh, partition, problem_form(problem, mesh))
    discrete = discretise_on_condensed_spaces(problem, spaces)
    mu = lambda_H[discrete.cells]
    result = DualResult(mu, math.nan, 0, bound=math.nan, converged=True, rho=math.nan, algorithm="given")
    # u_h = u_D + w with (w, v)_1 = (f, v) - (u_D, v)_1 + <mu, v>, which is (5.1) for the given mu
    potential = discrete.dirichlet_lift + discrete.spaces.response(discrete.homogeneous_data[0], mu)
    # the multiplier is given, so it is the only one
    return replace(discrete.make_solution(result, math.nan, potential), unique=True)


def _check_edge_multiplier(multiplier: ArrayLike, no_contact: Mask) -> Array:
    """Multiplier (nb,) of the user, with 0 for NaN on the edges of `no_contact` (nb,)."""
    values = read_floats(multiplier, "multiplier")
    if values.shape == no_contact.shape:
        values[no_contact & np.isnan(values)] = 0.0
    _check_finite_values(values, len(no_contact), "multiplier", "boundary edge")
    wrong = np.flatnonzero(np.where(no_contact, values != 0, values < 0))
    if wrong.size:
        requirement = "0 or NaN on free and clamped sides" if no_contact[wrong[0]] else "0 or more"
        raise InputError(f"multiplier[{wrong[0]}] is {values[wrong[0]]:.6g}; it has to be {requirement}")
    return values


def _check_finite_values(values: Array, count: int, name: str, place: str) -> None:
    """Raises InputError unless there are `count` values whose squares are no overflow."""
    if values.shape != (count,):
        raise InputError(
            f"{name} has the shape {values.shape}; it has to be ({count},), a value at each {place}"
        )
    wrong = np.flatnonzero(~(np.abs(values) < MAX_INPUT_VALUE))
    if wrong.size:
        raise InputError(
            f"{name}[{wrong[0]}] is {values[wrong[0]]}; it has to be finite, below {MAX_INPUT_VALUE:g}"
        )
