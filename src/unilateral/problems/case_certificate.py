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
from unilateral.problems.problem import Problem, remaining_sides

PROVED_RATES = {"h1": 1.0, "hm12": 1.0, "l2": 0.5}
"""The rates proved by (4.11), (4.12) and (4.13), where (j), (jj) and (jjj) hold."""
SAMPLES_PER_SIDE = 2001
CASE_ROUND_OFF = 1e-12
"""Numbers that differ by this part of their scale are the same.

That of a gap and of lambda is the largest on its side or, as u is one function, `_reference_size`. At a
vertex it is the largest number there; to that comes the rounding of u on the two sides.
"""
CASE_U_ROUNDING = 64 * EPS
"""u and the gaps of a case are rounded by at most this part of their largest value on a side."""
CASE_ZERO_TOLERANCE = 1e-14
"""A relative value up to this counts as 0.

The slowest function here, a cutoff's (8 s)^4, is larger at a sample's distance from its zero.
"""


class CaseCertificate(NamedTuple):
    """What was found: the hypotheses by name, and the contact set as (side, start, end) in side lengths.

    `g_regular` is the hypothesis of our Theorem 1 in place of (jj) and (jjj): u - g is in H^{3/2} on every
    side, and so, with (j), is g.
    """

    hypotheses: dict[str, bool]
    g_regular: bool
    contact: tuple[tuple[int, float, float], ...]
    max_multiplier: float
    max_gap: float


class _SideSample(NamedTuple):
    """u, lambda and the gap in points t of a side, all (k,)."""

    side: int
    t: Array
    u: Array
    lambda_: Array
    gap: Array


def certify_case(case: ExactSolution) -> CaseCertificate:
    """The certificate of a case.

    Raises InputError, with the point, where lambda < 0, u < g, lambda (u - g) is not 0, both vanish on
    an interval, or g jumps at a vertex; and where the declared hypotheses are not the derived ones.
    """
    samples = [_sample_side(case, side) for side in range(case.polygon.n_sides)]
    size = _reference_size(case, samples)
    for sample in samples:
        (_check_clamped_values if sample.side in case.clamped_values else _check_contact)(case, sample, size)
    if not (case.c or case.clamped_values):
        raise InputError(f"case '{case.name}', field c: it is 0, and no side is clamped")
    _check_continuity(case, samples)
    hypotheses = _derive_hypotheses(case)
    contact_sides = remaining_sides(case.polygon, case.clamped_values)
    bounded = all(atom.regularity.flux_bounded for atom in case.atoms)
    max_multiplier = max(0.0, *(float(sample.lambda_.max()) for sample in samples))
    return CaseCertificate(
        hypotheses,
        g_regular=case.gap_order > 3 / 2,
        contact=tuple((i, a, b) for i in contact_sides for a, b in _find_contact_intervals(case, i)),
        max_multiplier=max_multiplier if bounded else math.inf,
        max_gap=max(0.0, *(float(sample.gap.max()) for sample in samples)),
    )


def _sample_side(case: ExactSolution, side: int) -> _SideSample:
    """Midpoints of a uniform grid, and geometric sequences about the singular points, inside the side."""
    uniform = (np.arange(SAMPLES_PER_SIDE) + 0.5) / SAMPLES_PER_SIDE
    near = np.logspace(-9, -2, 36)  # distances in side lengths
    points = [p.t + sign * near for p in case.singular_points() if p.side == side for sign in (-1, 1)]
    t = np.unique(np.concatenate([uniform, *points]))
    t = t[(t > 0) & (t < 1)]
    with np.errstate(all="ignore"):
        return _SideSample(
            side, t, *case.trace_flux_and_gap(np.full(len(t), side), t * case.polygon.lengths[side])
        )


def _reference_size(case: ExactSolution, samples: list[_SideSample]) -> float:
    """The largest |u| and, times the diameter, typical |lambda| of a side, with which 0 is compared."""
    # typical is the median, for lambda may be infinite at singular points
    diameter = case.polygon.diameter
    sizes = [(np.max(np.abs(s.u)), diameter * np.median(np.abs(s.lambda_))) for s in samples]
    return float(np.max(np.nan_to_num(sizes, posinf=0.0)))


def _check_contact(case: ExactSolution, sample: _SideSample, size: float) -> None:
    """Raises InputError with the first point that fails."""
    side, t, _, flux, gap = sample
    # What counts as 0: lambda has the size of u over the diameter at least
    scale_gap = max(size, np.max(np.abs(gap)))
    flux_floor = scale_gap / case.polygon.diameter
    scale_flux = max(flux_floor, np.max(np.abs(flux)))
    # beside a singularity all other values would count as 0
    typical = max(flux_floor, np.median(np.abs(flux[flux != 0]))) if np.any(flux) else flux_floor
    empty = (flux <= CASE_ZERO_TOLERANCE * typical) & (gap <= CASE_ZERO_TOLERANCE * scale_gap)
    # Two neighbours of the uniform grid, not of the points that come close to a singular one
    interval = np.flatnonzero(empty[1:] & empty[:-1] & (np.diff(t) > 0.1 / SAMPLES_PER_SIDE))
    for bad, fault in (
        (~np.isfinite(flux) | ~np.isfinite(gap), "lambda or the gap is not finite"),
        (flux < -CASE_ROUND_OFF * scale_flux, "lambda = du/dn < 0"),
        (gap < -CASE_ROUND_OFF * scale_gap, "u - g < 0"),
        (np.abs(flux * gap) > CASE_ROUND_OFF * scale_flux * scale_gap, "lambda (u - g) is not 0"),
        (np.isin(np.arange(len(t)), interval), "lambda and u - g vanish together on an interval"),
    ):
        if np.any(bad):
            k = int(np.flatnonzero(bad)[0])
            values = f"lambda = {flux[k]:.6g}, u - g = {gap[k]:.6g}"
            raise InputError(f"{_describe_case_point(case, side, t[k])}: {fault} ({values})")


def _check_clamped_values(case: ExactSolution, sample: _SideSample, size: float) -> None:
    """Raises InputError where u differs from the declared u on a clamped side."""
    x, y = case.polygon.at(
        np.full(len(sample.t), sample.side), sample.t * case.polygon.lengths[sample.side]
    ).T
    declared = compile_numpy([case.clamped_values[sample.side]], "xy")(x, y)[0]
    k = int(np.argmax(np.abs(sample.u - declared)))
    if abs(sample.u[k] - declared[k]) > CASE_ROUND_OFF * size:
        values = f"u = {sample.u[k]:.6g}, declared is {declared[k]:.6g}"
        raise InputError(
            f"{_describe_case_point(case, sample.side, sample.t[k])}: u is not as declared ({values})"
        )


def _find_contact_intervals(case: ExactSolution, side: int) -> list[tuple[float, float]]:
    """The maximal intervals of a side on which the gap is 0, between singular points."""
    # Between singular points the gap is 0 everywhere or, up to single points, nowhere
    ends = np.unique([0.0, 1.0, *(p.t for p in case.singular_points() if p.side == side)])
    middles = 0.5 * (ends[1:] + ends[:-1])
    _, _, gap = case.trace_flux_and_gap(np.full(len(middles), side), middles * case.polygon.lengths[side])
    merged: list[tuple[float, float]] = []
    for start, end in zip(ends[:-1][gap == 0].tolist(), ends[1:][gap == 0].tolist(), strict=True):
        if merged and merged[-1][1] == start:
            start = merged.pop()[0]
        merged.append((start, end))
    return merged


def _check_continuity(case: ExactSolution, samples: list[_SideSample]) -> None:
    """Raises InputError where g, or u on clamped sides, jumps; of other sides' numbers nothing depends on."""
    n = case.polygon.n_sides
    lengths = case.polygon.lengths
    sides = np.arange(n)
    u_start, _, start = case.trace_flux_and_gap(sides, np.zeros(n))
    u_end, _, end = case.trace_flux_and_gap(sides, lengths)
    # g = u - gap on the side that starts at a vertex, less that on the side that ends there
    jump = (u_start - start) - np.roll(u_end - end, 1)
    clamped = np.isin(sides, case.clamped_sides)
    jump[clamped != np.roll(clamped, 1)] = 0.0  # there u >= g is enough
    vertex_size = np.maximum(np.abs([u_start, start]), np.abs(np.roll([u_end, end], 1, axis=1))).max(axis=0)
    side_sizes = [np.nan_to_num([np.abs(s.u).max(), np.abs(s.gap).max()]).max() for s in samples]
    allowed = CASE_ROUND_OFF * vertex_size + CASE_U_ROUNDING * np.maximum(side_sizes, np.roll(side_sizes, 1))
    worst = int(np.argmax(np.abs(jump) - allowed))
    if abs(jump[worst]) > allowed[worst]:
        raise InputError(
            f"{_describe_case_point(case, worst, 0.0)}: g jumps by {jump[worst]:.6g} at this vertex"
        )


def _describe_case_point(case: ExactSolution, side: int, t: float) -> str:
    x, y = case.polygon.point(side, t)
    return f"case '{case.name}' on '{case.polygon.name}' at ({x:.6g}, {y:.6g}), side {side}, t = {t:.6g}"


def _derive_hypotheses(case: ExactSolution) -> dict[str, bool]:
    """Which hypotheses of Theorem 4.1 hold, by name. Raises InputError where the case declares others."""
    # (j) u in H^2; (jj) u and g = u - gap Lipschitz on sides; (jjj) finitely many transitions
    regularities = [atom.regularity for atom in case.atoms]
    lipschitz_gap = all(k >= 1 for side in case.gap_kinks for _, k in side)
    hypotheses = {
        "j": all(regularity.in_H2 for regularity in regularities),
        "jj": all(regularity.lipschitz for regularity in regularities) and lipschitz_gap,
        "jjj": all(regularity.finite for regularity in regularities),
    }
    for name, value in hypotheses.items():
        if case.declaration["hypotheses"][name] != value:
            found_out = f"({name}) {'holds' if value else 'does not hold'}, declared otherwise"
            raise InputError(f"case '{case.name}', field hypotheses.{name}: {found_out}")
    return hypotheses


def set_free_sides(case: Problem, sides: Sequence[int]) -> Problem:
    """The case with those sides free, which changes nothing of its solution: lambda is 0 there.

    Raises InputError for sides that do not exist, have contact or are clamped, and if all would be free.
    """
    contact = {side for side, _, _ in certify_case(case.known_solution()).contact}
    n = case.polygon.n_sides
    for side in arguments.as_side_numbers(sides, case.polygon, "free sides"):
        if side in case.clamped_sides:
            raise InputError(f"free sides: case '{case.name}' is clamped on side {side}")
        if side in contact:
            raise InputError(f"free sides: case '{case.name}' has contact on side {side}")
    if len(set(sides)) == n:
        raise InputError("free sides: one side at least must not be free")
    return replace(case, free_sides=tuple(sorted(set(sides))))
