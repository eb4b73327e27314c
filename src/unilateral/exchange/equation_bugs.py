"""Which bug explains what u leaves of the equation inside: undoing it leaves a right solution.

A bug adds c times its signature to the equation's residual. With the stiffness matrix K and the mass matrix M

    K u + (1 - c) M u = f       the mass term
    (1 - c) K u + M u = f       the stiffness term
    K u + M u = (1 + c) f       the load, the matrix or u
    K u / 2 + 2 M u = f         areas of triangles that are twice the right ones
    K u + c M u = f             a mass term that is not in the equation, if its coefficient is 0

and c is found by least squares in the dual norm of the hats inside.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from unilateral.arrays import Array, Mask
from unilateral.exchange.boundary_function import Trace
from unilateral.exchange.equation_residual import Residual, loads
from unilateral.exchange.exported_folder import SAME
from unilateral.exchange.fault import Fault, wrong
from unilateral.fem.form import Form
from unilateral.fem.p1 import energy_norm, of_rest, stiffness_and_mass
from unilateral.problems.problem import Problem

EXPLAINS = 0.1
"""A bug is named if at most this fraction of what is wrong is left without it, 1 % of the square."""
NOTHING = 1e-3
"""Less than this fraction of what may be left is as good as nothing, and not compared."""
ROUNDED = 1e-12
"""Rounding of u leaves at most this fraction of it: EPS (4 n)^(1/2) on n nodes."""

EXACT = 1e-6
"""A factor below this counts as 0."""
MIXED = 10
"""u counts as renumbered only if its distance from the right values is more than this many times two others.

These are the distance of both if they are sorted, and that of the right values from the exact ones.
"""


class Undone(NamedTuple):
    """A bug, and the `residual` without it; `multiplier` makes of one that was handed in what it then is.

    The bug may be one of `both`, of u and of the multiplier.
    """

    bug: Fault
    residual: Residual
    multiplier: Callable[[Trace], Trace] = lambda mu: mu
    both: bool = False


def with_load(case: Problem, exported: Residual, mu: Array | None, allowed: float) -> tuple[Residual, str]:
    """The residual with the load that u's equation has, and that load's name: the exported one if in doubt.

    Another load has to leave no more than `allowed` inside, and hardly anything of what the exported one
    leaves. If the exported one leaves more than `allowed` inside, that is compared inside. Else it is
    compared on V_h, beside the boundary load mu (nb,) of the multiplier, if there is one.
    """
    beside = None if exported.inside > allowed else mu
    left = exported.whole(beside)
    if left <= NOTHING * allowed:
        return exported, ""
    best = (exported, "")
    of_best = EXPLAINS * left
    for name, load in loads(case.known_solution(), exported.discrete):
        of = replace(exported, load=load)
        if np.isfinite(load).all() and of.inside <= allowed and (left := of.whole(beside)) < of_best:
            best = (of, name)
            of_best = left
    return best


def explanations(case: Problem, plain: Residual, allowed: float) -> list[Undone]:
    """The bugs that, undone, leave no more than `allowed` and hardly anything of the `plain` residual."""
    most = min(allowed, EXPLAINS * plain.inside)
    for _, load in loads(case.known_solution(), plain.discrete):
        if np.isfinite(load).all():
            of = Residual(plain.discrete, plain.u, load)
            found = [each for each in _bugs(of) if each.residual.inside <= most]
            if found:
                # those that leave not clearly more than another one does
                smallest = min(each.residual.inside for each in found)
                least = max(smallest / EXPLAINS, NOTHING * most)
                return [each for each in found if each.residual.inside <= least]
    return list(_exchanged(plain, most))


def _bugs(of: Residual) -> Iterator[Undone]:
    """Each bug of u's equation that is known, undone with the factor that fits best."""
    stiffness, mass = stiffness_and_mass(of.discrete.mesh)
    K_u = stiffness @ of.u
    M_u = mass @ of.u
    if of.discrete.form.c:
        for term, signature in (("mass term (u, v)", M_u), ("stiffness term (grad u, grad v)", K_u)):
            c = of.share(signature)
            without = of.plus(c * signature)
            yield Undone(_factor(f"the {term}", 1 - c, signature, without), without)
        areas = 0.5 * K_u - M_u
        told = "(grad u, grad v) / 2 + 2 (u, v) fits f"
        yield Undone(Fault("the triangles' areas are twice the right ones", told), of.plus(areas))
    else:
        c = of.share(M_u)
        fault = Fault("there is a mass term (u, v), but c = 0", f"{-c:.6g} times (u, v)")
        yield Undone(fault, of.plus(c * M_u))
    yield from _of_load(of)
    for off in not_given(of, 0.0):
        given = np.where(of.discrete.spaces.condensed.fixed, of.discrete.held, of.u)
        yield Undone(off, replace(of, u=given))


def _of_load(of: Residual) -> Iterator[Undone]:
    """What may have a wrong factor, if (u, v)_1 = factor (f, v) inside."""
    factor = 1 + of.share(of.load)
    scaled = Residual(of.discrete, of.u, factor * of.load)
    load = _factor("the load (f, v)", factor, of.load, scaled)
    yield Undone(load, scaled)
    if _is_missing(factor, of.load, scaled):
        return
    if factor > 0:
        yield Undone(wrong(f"the matrix of {of.names[0]}", 1 / factor), scaled, lambda mu: mu.times(factor))
    divided = Residual(of.discrete, of.u / factor, of.load)
    yield Undone(wrong("u", factor), divided)
    yield Undone(wrong("u, like the multiplier,", factor), divided, lambda mu: mu.times(1 / factor), True)


def _factor(name: str, factor: float, term: Array, of: Residual) -> Fault:
    """The fault that a term (n,) has a wrong factor, or is missing."""
    if _is_missing(factor, term, of):
        return Fault(f"{name} is missing", "the equation holds inside without it")
    return wrong(name, factor)


def _is_missing(factor: float, term: Array, of: Residual) -> bool:
    """Whether the factor of a term (n,) is 0 as far as one can see."""
    size = of.size(term)
    return abs(factor) * size <= of.inside + EXACT * size


def _exchanged(plain: Residual, most: float) -> Iterator[Undone]:
    """The bug that x and y are exchanged, where the mesh is its own mirror image."""
    mesh = plain.discrete.mesh
    distance, node = cKDTree(mesh.points).query(mesh.points[:, ::-1])
    if distance.max() > SAME * mesh.h:
        return
    of = Residual(plain.discrete, plain.u[node], plain.load)
    if of.inside <= most:
        bug = Fault("x and y are exchanged", "the equation holds inside at (y, x)")
        yield Undone(bug, of, lambda mu: mu.carried(mesh, node))


def not_given(of: Residual, allowed: float) -> Iterator[Fault]:
    """The fault that u is not u_D at nodes of clamped sides, if that alone is an error above `allowed` in H1.

    The energy would be no measure: if c = 0, constants have none.
    """
    discrete = of.discrete
    condensed = of.discrete.spaces.condensed
    mesh = discrete.mesh
    form = discrete.form
    off = np.where(condensed.fixed, of.u - discrete.held, 0.0)
    least = off + condensed.solve(of_rest(mesh, form, np.zeros(len(off)), off))
    if energy_norm(mesh, least) <= allowed:
        return
    worst = np.abs(off).argmax()
    ends = np.abs(off[mesh.boundary]) > EXACT * abs(off[worst])
    sides = np.unique(mesh.side[form.edges(mesh) & (ends | np.roll(ends, -1))])
    how = _how(of, np.isin(mesh.side, sides), allowed + ROUNDED * abs(off[worst]))
    on = ", ".join(map(str, sides))
    (x, y) = mesh.points[worst]
    what = f"u is {how} on the clamped side{'s' * (len(sides) > 1)} {on}"
    yield Fault(what, f"u - u_D is {off[worst]:.2g} at ({x:g}, {y:g})")


def _how(of: Residual, edges: Mask, allowed: float) -> str:
    """What u is on those edges (nb,): left free if the equation holds at the nodes inside the sides, too."""
    mesh = of.discrete.mesh
    A = of.discrete.spaces.condensed.A
    inner = mesh.boundary[(edges & np.roll(edges, 1))]
    every = mesh.boundary[(edges | np.roll(edges, 1))]
    forces = of_rest(mesh, Form(c=of.discrete.form.c), of.load, of.u) / np.sqrt(A.diagonal())
    if inner.size and np.linalg.norm(forces[inner]) <= allowed:
        return "left free"
    return "not u_D" if of.u[every].any() else "0, not u_D,"


def renumbered(case: Problem, plain: Residual, u_h: Array) -> Fault | None:
    """The fault of another numbering, if the sorted values are nearly those of u_h (n,).

    They have to be as near to these as these are to the exact ones. All distances are root mean squares over
    the nodes. Sorted values are never farther apart than values at the nodes, so a right solution passes,
    however numbered. Twice the distance is allowed, as another method may err twice as much.
    """
    exact = case.known_solution().value_and_gradient(plain.discrete.mesh.points)[0]
    own = _rms(u_h - exact)
    here = _rms(plain.u - u_h)
    ordered = _rms(np.sort(plain.u) - np.sort(u_h))
    if ordered > 2 * own or here <= MIXED * max(own, ordered):
        return None
    return Fault(
        "the values of u are right, but at other nodes: x, y and u are numbered differently",
        f"u differs from the right values by {here:.2g}, and by {ordered:.2g} if both are sorted",
    )


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
