"""Why a solution is wrong, told from what it leaves of the equations that it claims to solve.

All is measured in the dual norm of V_h, where it is an error of u in H1. What is left counts from the share
of the discretisation error on that an algebraic error may have, for others as for this project.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from unilateral.arrays import Array
from unilateral.discrete import Discrete
from unilateral.errors import InputError
from unilateral.exchange.conditions import conditions
from unilateral.exchange.read import Foreign
from unilateral.exchange.residual import Fit, Residual, flux_load, residual
from unilateral.exchange.trace import Trace
from unilateral.fem.p1 import boundary_mass
from unilateral.geometry.mesh import Mesh
from unilateral.norms.dual import Errors
from unilateral.problems.case import Case
from unilateral.solvers.stop import Stop

COUNTS = Stop.fraction
"""Of this project's error on the same level. So far a rate over a factor of 2 changes by 0.03 at most."""
ROUNDING = 1e-10
"""Of the error of u: an error of lambda below it is 0."""


@dataclass(frozen=True, eq=False)
class Reading:
    """A multiplier as the boundary load (nb,) that it is if it was meant like that; `fault` says how."""

    fault: str
    load: Array
    mu: Trace


def faults(case: Case, given: Foreign, discrete: Discrete, own: Errors) -> list[str]:
    """What is wrong with a solution, beside this project's `own` errors on the level."""
    found, of = _inside(case, given.u, discrete, own)
    if given.multiplier is not None:
        plain = Reading("", given.multiplier.load(of.discrete.mesh), given.multiplier)
        if of.inside <= COUNTS * own.h1:
            found += _of_multiplier(case, plain, of, own)
        else:
            found += _against_exact(plain, of, own)
    return found


def _inside(case: Case, u: Array, discrete: Discrete, own: Errors) -> tuple[list[str], Residual]:
    """What is wrong with u (n,) inside, and what it leaves there, without the factor if that was wrong."""
    of, allowed = residual(case, discrete, u), COUNTS * own.h1
    if of.inside <= allowed:
        return [], of
    factor, left, size = of.fit
    if factor != 0 and left <= COUNTS * min(of.inside, abs(factor) * size):
        fault = _wrong("u, or the load,", factor, "f is what the equation holds with inside")
        return [fault], residual(case, discrete, u / factor)
    if _renumbered(case, of, own):
        return ["the values of u are right, but at other nodes: x, y and u are numbered differently"], of
    x, y = of.worst()
    return [
        f"the equation does not hold inside the domain, by {of.inside:.2g} in H1, least at ({x:g}, {y:g}): "
        "the linear solve stopped too early, the load is another one, or u is not meant as P1"
    ], of


def _renumbered(case: Case, of: Residual, own: Errors) -> bool:
    """Whether u is farther from the exact values than this project's error, and its sorted values are not."""
    mesh = of.discrete.mesh
    exact = case.value_and_gradient(mesh.points)[0]
    here, anywhere = (
        float(np.sqrt(mesh.polygon.area * np.mean((one - other) ** 2)))
        for one, other in ((of.u, exact), (np.sort(of.u), np.sort(exact)))
    )
    return anywhere <= own.h1 < here


def _wrong(name: str, factor: float, right: str) -> str:
    return f"{name} has the wrong {'sign' if factor < 0 else 'scale'}: {factor:.6g} times {right}"


def _of_multiplier(case: Case, plain: Reading, of: Residual, own: Errors) -> Iterator[str]:
    """By u's equation at the boundary, which says what the multiplier has to be, and by its conditions."""
    allowed = COUNTS * (own.hm12_lower if own.hm12_lower > ROUNDING * own.h1 else own.h1) + of.inside
    right, reading = of.nearer_to(plain.load), plain
    if of.norm(plain.load - right) > allowed:
        reading = next(_fitting(plain, of, right, allowed), plain)
        fit = of.fitted(reading.load, right)
        yield from filter(None, [reading.fault])
        if fit.misfit > allowed and _scaled(fit, allowed):
            yield _wrong("the multiplier", fit.factor, f"what u's equation has, to {fit.left / fit.size:.1g}")
        elif not reading.fault:
            what = "(u, v)_1 - <lambda, v> - (f, v)"
            yield f"u and the multiplier do not fit: {what} is {fit.misfit:.2g} in H1"
    yield from _stopped(case, reading.mu, of, allowed)


def _fitting(plain: Reading, of: Residual, right: Array, allowed: float) -> Iterator[Reading]:
    """The readings that are, but for a factor, the right load (nb,)."""
    for reading in _readings(plain, of.discrete.mesh):
        fit = of.fitted(reading.load, right)
        if fit.left <= abs(fit.factor) * allowed:
            yield reading


def _readings(plain: Reading, mesh: Mesh) -> Iterator[Reading]:
    """How the multiplier may have been meant."""
    mu = plain.mu
    yield plain
    if mu.nodal is not None:
        lumped = boundary_mass(mesh).sum(axis=1) * mu.nodal
        yield Reading(
            "the multiplier is lumped: its values are reactions over the row sums of the mass matrix",
            lumped,
            mu,
        )
        return
    for clockwise in (True, False):
        for vertex, start in enumerate(mesh.polygon.starts[:-1].tolist()):
            with suppress(InputError):
                moved = mu.moved(start, clockwise)
                yield Reading(
                    f"the cells' arc length begins at vertex {vertex} and runs "
                    f"{'clockwise' if clockwise else 'anticlockwise'}; it has to begin at vertex 0 and run "
                    "anticlockwise",
                    moved.load(mesh),
                    moved,
                )


def _scaled(fit: Fit, allowed: float) -> bool:
    """Whether the multiplier surely has the wrong sign, or nothing but a factor is wrong with it."""
    of_factor = abs(fit.factor - 1) * fit.size
    only = fit.left < of_factor and fit.left <= max(abs(fit.factor) * allowed, COUNTS * fit.misfit)
    return only or fit.factor * fit.size < -fit.left


def _against_exact(plain: Reading, of: Residual, own: Errors) -> Iterator[str]:
    """A sign that is surer than what is left and this project's error, where u says nothing."""
    fit = of.fitted(plain.load, flux_load(of.discrete))
    uncertain = fit.left + own.hm12_upper
    if fit.factor * fit.size < -uncertain:
        yield _wrong("the multiplier", fit.factor, f"the exact one, to {uncertain / fit.size:.1g}")


def _stopped(case: Case, mu: Trace, of: Residual, allowed: float) -> Iterator[str]:
    """How far u is from the solutions with the conditions that belong to mu, if it is none of them."""
    missed = {}
    for each in conditions(case, of.discrete, mu):
        load, bound = each.multiplier_load(of.discrete, of.load, allowed)
        missed[each.what] = of.norm(of.boundary - load) - bound
        if missed[each.what] <= allowed:
            return
    what = min(missed, key=lambda what: missed[what])
    yield (
        f"u is {missed[what]:.2g} in H1 from the solution with u >= g {what}: the iteration stopped "
        "too early, or g or the conditions are others"
    )
