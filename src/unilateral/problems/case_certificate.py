"""The certificate of a case: that it solves (1.1)-(1.2), and which hypotheses of Theorem 4.1 hold.

Signs and complementarity are checked in sampled points, dense on every side and geometrically denser
towards every declared singular point; regularity follows from the atoms' and the gap's exponents,
for it cannot be read off a formula.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from unilateral.arrays import Array
from unilateral.errors import InputError
from unilateral.formulas.formula import compile_numpy
from unilateral.formulas.taylor import EPS
from unilateral.problems import arguments
from unilateral.problems.case import ExactSolution
from unilateral.problems.problem import Problem, contact_sides

PROVED = {"h1": 1.0, "hm12": 1.0, "l2": 0.5}
"""The rates proved by (4.11), (4.12) and (4.13), where (j), (jj) and (jjj) hold."""
SAMPLES = 2001
ROUND_OFF = 1e-12
"""Numbers that differ by this part of their scale are the same.

That of a gap and of lambda is the largest on its side or, as u is one function, `_size`. At a vertex it is
the largest number there; to that comes the rounding of u on the two sides.
"""
OF_U = 64 * EPS
"""u and the gaps of a case are rounded by at most this part of their largest value on a side."""
VANISHES = 1e-14
"""A relative value up to this counts as 0.

The slowest function here, a cutoff's (8 s)^4, is larger at a sample's distance from its zero.
"""


class Certificate(NamedTuple):
    """What was found: the hypotheses by name, and the contact set as (side, start, end) in side lengths.

    `g_regular` is the hypothesis of our Theorem 1 in place of (jj) and (jjj): u - g is in H^{3/2} on every
    side, and so, with (j), is g.
    """

    hypotheses: dict[str, bool]
    g_regular: bool
    contact: tuple[tuple[int, float, float], ...]
    lambda_max: float
    gap_max: float


class _Sample(NamedTuple):
    """u, lambda and the gap in points t of a side, all (k,)."""

    side: int
    t: Array
    u: Array
    flux: Array
    gap: Array


def certify(case: ExactSolution) -> Certificate:
    """The certificate of a case.

    Raises InputError, with the point, where lambda < 0, u < g, lambda (u - g) is not 0, both vanish on
    an interval, or g jumps at a vertex; and where the declared hypotheses are not the derived ones.
    """
    samples = [_sample(case, side) for side in range(case.polygon.n_sides)]
    size = _size(case, samples)
    for sample in samples:
        (_check_given if sample.side in case.values else _check)(case, sample, size)
    if not (case.c or case.values):
        raise InputError(f"case '{case.name}', field c: it is 0, and no side is clamped")
    _continuous_at_vertices(case, samples)
    known = [atom.regularity for atom in case.atoms]
    lipschitz_gap = all(k >= 1 for side in case.gap_kinks for _, k in side)
    hypotheses = {
        "j": all(each.in_H2 for each in known),
        "jj": all(each.lipschitz for each in known) and lipschitz_gap,
        "jjj": all(each.finite for each in known),
    }
    _as_declared(case, hypotheses)
    of_contact = contact_sides(case.polygon, case.values)
    bounded = all(each.flux_bounded for each in known)
    return Certificate(
        hypotheses,
        case.gap_order > 3 / 2,
        tuple((side, a, b) for side in of_contact for a, b in _contact(case, side)),
        lambda_max=max(0.0, *(float(sample.flux.max()) for sample in samples)) if bounded else math.inf,
        gap_max=max(0.0, *(float(sample.gap.max()) for sample in samples)),
    )


def _sample(case: ExactSolution, side: int) -> _Sample:
    """Midpoints of a uniform grid, and geometric sequences about the singular points, inside the side."""
    uniform = (np.arange(SAMPLES) + 0.5) / SAMPLES
    near = np.logspace(-9, -2, 36)
    points = [p.t + sign * near for p in case.singular() if p.side == side for sign in (-1, 1)]
    t = np.unique(np.concatenate([uniform, *points]))
    t = t[(t > 0) & (t < 1)]
    with np.errstate(all="ignore"):
        return _Sample(side, t, *case.boundary(np.full(len(t), side), t * case.polygon.lengths[side]))


def _size(case: ExactSolution, samples: list[_Sample]) -> float:
    """What 0 is compared with: the largest |u| and, times the diameter, typical |lambda| of a side."""
    sizes = [
        (np.max(np.abs(sample.u)), case.polygon.diameter * np.median(np.abs(sample.flux)))
        for sample in samples
    ]
    return float(np.max(np.nan_to_num(sizes, posinf=0.0)))


def _check(case: ExactSolution, sample: _Sample, size: float) -> None:
    """Raises InputError with the first point that fails."""
    side, t, _, flux, gap = sample
    scale_gap = max(size, np.max(np.abs(gap)))
    least = scale_gap / case.polygon.diameter
    scale_flux = max(least, np.max(np.abs(flux)))
    typical = max(least, np.median(np.abs(flux[flux != 0]))) if np.any(flux) else least
    empty = (flux <= VANISHES * typical) & (gap <= VANISHES * scale_gap)
    interval = np.flatnonzero(empty[1:] & empty[:-1] & (np.diff(t) > 0.1 / SAMPLES))
    for bad, what in (
        (~np.isfinite(flux) | ~np.isfinite(gap), "lambda or the gap is not finite"),
        (flux < -ROUND_OFF * scale_flux, "lambda = du/dn < 0"),
        (gap < -ROUND_OFF * scale_gap, "u - g < 0"),
        (np.abs(flux * gap) > ROUND_OFF * scale_flux * scale_gap, "lambda (u - g) is not 0"),
        (np.isin(np.arange(len(t)), interval), "lambda and u - g vanish together on an interval"),
    ):
        if np.any(bad):
            k = int(np.flatnonzero(bad)[0])
            values = f"lambda = {flux[k]:.6g}, u - g = {gap[k]:.6g}"
            raise InputError(f"{_place(case, side, t[k])}: {what} ({values})")


def _check_given(case: ExactSolution, sample: _Sample, size: float) -> None:
    """Raises InputError where u differs from the declared u on a clamped side."""
    x, y = case.polygon.at(
        np.full(len(sample.t), sample.side), sample.t * case.polygon.lengths[sample.side]
    ).T
    given = compile_numpy([case.values[sample.side]], "xy")(x, y)[0]
    k = int(np.argmax(np.abs(sample.u - given)))
    if abs(sample.u[k] - given[k]) > ROUND_OFF * size:
        values = f"u = {sample.u[k]:.6g}, declared is {given[k]:.6g}"
        raise InputError(f"{_place(case, sample.side, sample.t[k])}: u is not as declared ({values})")


def _contact(case: ExactSolution, side: int) -> list[tuple[float, float]]:
    """The maximal intervals of a side on which the gap is 0, between singular points."""
    ends = np.unique([0.0, 1.0, *(p.t for p in case.singular() if p.side == side)])
    middles = 0.5 * (ends[1:] + ends[:-1])
    _, _, gap = case.boundary(np.full(len(middles), side), middles * case.polygon.lengths[side])
    merged: list[tuple[float, float]] = []
    for start, end in zip(ends[:-1][gap == 0].tolist(), ends[1:][gap == 0].tolist(), strict=True):
        if merged and merged[-1][1] == start:
            start = merged.pop()[0]
        merged.append((start, end))
    return merged


def _continuous_at_vertices(case: ExactSolution, samples: list[_Sample]) -> None:
    """Raises InputError where g, or u on clamped sides, jumps; of other sides' numbers nothing depends on."""
    n = case.polygon.n_sides
    lengths = case.polygon.lengths
    sides = np.arange(n)
    u_start, _, start = case.boundary(sides, np.zeros(n))
    u_end, _, end = case.boundary(sides, lengths)
    jump = (u_start - start) - np.roll(u_end - end, 1)
    clamped = np.isin(sides, case.clamped_sides)
    jump[clamped != np.roll(clamped, 1)] = 0.0  # there u >= g is enough
    there = np.maximum(np.abs([u_start, start]), np.abs(np.roll([u_end, end], 1, axis=1))).max(axis=0)
    on_sides = [np.nan_to_num([np.abs(s.u).max(), np.abs(s.gap).max()]).max() for s in samples]
    allowed = ROUND_OFF * there + OF_U * np.maximum(on_sides, np.roll(on_sides, 1))
    worst = int(np.argmax(np.abs(jump) - allowed))
    if abs(jump[worst]) > allowed[worst]:
        raise InputError(f"{_place(case, worst, 0.0)}: g jumps by {jump[worst]:.6g} at this vertex")


def _place(case: ExactSolution, side: int, t: float) -> str:
    x, y = case.polygon.point(side, t)
    return f"case '{case.name}' on '{case.polygon.name}' at ({x:.6g}, {y:.6g}), side {side}, t = {t:.6g}"


def _as_declared(case: ExactSolution, hypotheses: dict[str, bool]) -> None:
    for name, value in hypotheses.items():
        if case.declaration["hypotheses"][name] != value:
            found_out = f"({name}) {'holds' if value else 'does not hold'}, declared otherwise"
            raise InputError(f"case '{case.name}', field hypotheses.{name}: {found_out}")


def with_free_sides(case: Problem, free: Sequence[int]) -> Problem:
    """The case with those sides free, which changes nothing of its solution: lambda is 0 there.

    Raises InputError for sides that do not exist or have contact, and if all sides would be free.
    """
    contact = {side for side, _, _ in certify(case.known_solution()).contact}
    n = case.polygon.n_sides
    for side in arguments.sides(free, n, "free sides"):
        if side in case.clamped_sides:
            raise InputError(f"free sides: case '{case.name}' is clamped on side {side}")
        if side in contact:
            raise InputError(f"free sides: case '{case.name}' has contact on side {side}")
    if len(set(free)) == n:
        raise InputError("free sides: one side at least must not be free")
    return replace(case, free_sides=tuple(sorted(set(free))))
