"""Why a solution is wrong, told from simple tests.

They are the factor that would make it fit best, the residual of (u_h, v)_1 - <lambda_H, v> = (f, v), and the
distance from the solution of the discrete problem that it claims to solve. Residuals are measured in the dual
norm of V_h, so that they are errors of u_h in H1.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from unilateral.arrays import Array
from unilateral.discrete import Discrete, discretise, solve
from unilateral.discrete_solution import Solution
from unilateral.exchange.read import Foreign
from unilateral.exchange.trace import Trace, constant
from unilateral.fem.p1 import boundary_mass
from unilateral.fem.spaces import dual_operator
from unilateral.norms.dual import Errors
from unilateral.problems.case import Case
from unilateral.solvers.active_set import active_set

FACTOR = 0.1
"""How far from 1 the best factor has to be; the distance then falls to less than half, too."""
SHARE = 0.5
"""Of this project's error on the same level: what a residual may have."""
ROUNDING = 1e-10
"""Of what the numbers are made of: a problem is solved so far, and an error below it is 0."""


@dataclass(frozen=True, eq=False)
class Residual:
    """`inside`: its norm on functions that are 0 on the boundary; `boundary` (nb,): A u - f there."""

    discrete: Discrete
    inside: float
    boundary: Array

    def norm(self, load: Array) -> float:
        """sup over V_h of a boundary load (nb,)."""
        solved = self.discrete.spaces.condensed.solve_boundary(load)
        return math.sqrt(max(float(load @ solved), 0.0))


def residual(discrete: Discrete, u: Array) -> Residual:
    """Of u (n,) without a multiplier. With A_II the block of inner nodes, A_II^{-1} comes from that of A."""
    condensed, boundary = discrete.spaces.condensed, discrete.mesh.boundary
    r = condensed.A @ u - discrete.load
    inner = r.copy()
    inner[boundary] = 0.0
    x = condensed.solve(inner)
    square = inner @ x - x[boundary] @ (condensed.A_3 @ x[boundary])
    return Residual(discrete, math.sqrt(max(float(square), 0.0)), r[boundary])


def faults(case: Case, given: Foreign, discrete: Discrete, solved: Solution, own: Errors) -> list[str]:
    """What is wrong with a solution, beside this project's, `solved`, and its `own` errors on the level."""
    found = list(_factor("u", np.ones(len(given.u)), solved.u_h, given.u))
    of = residual(discrete, given.u)
    if not found and of.inside > SHARE * own.h1:
        found.append(
            f"the equation does not hold inside the domain, by {of.inside:.2g} in H1: the linear solve "
            "stopped too early, or the load is another one"
        )
    if given.multiplier is not None:
        own_mu = constant(given.level.cells, solved.lambda_H)
        seen = not any(_factor("lambda_H", *own_mu.beside(case)))
        found += _of_multiplier(case, given.multiplier, of, own, seen, sound=not found)
    return found


def _factor(name: str, weight: Array, right: Array, found: Array) -> Iterator[str]:
    """Wrong sign or scale: by the factor with which `found` is nearest to the right values."""
    square = weight @ found**2
    if square == 0 or weight @ right**2 == 0:
        return
    c = float(weight @ (right * found) / square)
    before, after = (weight @ (right - factor * found) ** 2 for factor in (1.0, c))
    if abs(c - 1) > FACTOR and after < before / 4:
        fault = "sign" if c < 0 else "scale"
        yield f"{name} has the wrong {fault}: {c:.3g} times it would fit best"


def _of_multiplier(
    case: Case, mu: Trace, of: Residual, own: Errors, seen: bool, sound: bool
) -> Iterator[str]:
    """`seen`: the level is fine enough for lambda_H to fit lambda; `sound`: nothing is wrong with u."""
    scaled = list(_factor("the multiplier", *mu.beside(case))) if seen else []
    yield from scaled
    if seen and not scaled and mu.nodal is None and _square(mu.reversed(), case) < _square(mu, case) / 4:
        yield "the multiplier's cells are numbered clockwise; arc length runs anticlockwise"
    elif not scaled and sound:
        yield from _of_equation(case, mu, of, own)


def _square(mu: Trace, case: Case) -> float:
    weight, flux, values = mu.beside(case)
    return float(weight @ (flux - values) ** 2)


def _of_equation(case: Case, mu: Trace, of: Residual, own: Errors) -> Iterator[str]:
    """Whether mu is what u's equation has on the boundary, and both solve their discrete problem."""
    allowed = SHARE * (own.hm12_lower if own.hm12_lower > ROUNDING * own.h1 else own.h1)
    misfit = of.norm(of.boundary - mu.load(of.discrete.mesh))
    if misfit > allowed:
        masses = boundary_mass(of.discrete.mesh).sum(axis=1)
        if mu.nodal is not None and of.norm(of.boundary - masses * mu.nodal) < misfit / 2:
            yield "the multiplier is lumped: its values are reactions over the row sums of the mass matrix"
        else:
            yield f"u and the multiplier do not fit: (u, v)_1 - <lambda, v> - (f, v) is {misfit:.2g} in H1"
            return
    missed = _from_solution(case, mu, of)
    if missed > allowed:
        yield (f"the iteration stopped too early: u is {missed:.2g} in H1 from what it would converge to")


def _from_solution(case: Case, mu: Trace, of: Residual) -> float:
    """||u - u_h||_1, u_h solved for with the constraints that belong to mu.

    These are means over the cells where mu is constant there, and values at the nodes where it is P1. NaN
    where lambda_H is not unique.
    """
    return of.norm(of.boundary - (_nodal(case, of) if mu.nodal is not None else _mixed(case, mu, of)))


def _mixed(case: Case, mu: Trace, of: Residual) -> Array:
    """(nb,) the load of lambda_H on the cells of mu."""
    same = np.array_equal(mu.cells.points, of.discrete.partition.points)
    discrete = of.discrete if same else discretise(case, of.discrete.mesh, mu.cells)
    if not discrete.unique:
        return np.full(len(of.boundary), math.nan)
    return np.asarray(discrete.spaces.B.T @ solve(discrete).result.lambda_H)


def _nodal(case: Case, of: Residual) -> Array:
    """(nb,) the reactions where u >= g holds at the nodes."""
    import scipy.sparse as sp

    condensed, mesh = of.discrete.spaces.condensed, of.discrete.mesh
    masses = np.asarray(boundary_mass(mesh).sum(axis=1))
    operator = dual_operator(condensed, sp.diags_array(masses).tocsr(), masses)
    u, _, gap = case.boundary(mesh.side, mesh.s[:-1] - mesh.polygon.starts[mesh.side])
    offset = condensed.solve(of.discrete.load)[mesh.boundary] - (u - gap)
    tolerance = ROUNDING * max(float(np.abs(offset).max()), 1e-300)
    return masses * active_set(operator, offset, tolerance).lambda_H
