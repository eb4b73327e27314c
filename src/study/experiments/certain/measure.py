"""What is certain of contact, against exact contact sets, and how near to the ends of contact it is.

Arcs are those of `contact.certain` by the cheap bound. Beside an end of contact a distance to an arc that is
proved falls like a power of h. It is 1/gamma where the gap is like r^gamma, and 1/(1 + alpha) where lambda is
like r^alpha, by Section "Contact for certain" of the supplement.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import chain
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from study import scenes, tables
from unilateral.arrays import Array
from unilateral.bounds.certain_contact import CertainArc, Verdict, find_certain_contact
from unilateral.formulas.formula import parse_real
from unilateral.problems.case import ExactSolution
from unilateral.problems.case_certificate import certify_case
from unilateral.solution.solution import Solution
from unilateral.solution.solver import Solver

EXPONENT_STEP = 1e-4
"""Exponents at ends of contact are read off u - g and lambda at this distance, over the side's length."""
RISE_OVER_BOUND = 5.0
"""For a control u_h is higher by so many times its bound, and lambda_H is 0."""
ORDER_DIGITS = 2
"""Orders are rounded to so many digits."""


class ExactContact(NamedTuple):
    """A part of a side on which u = g, between two arc lengths from the start of the side."""

    side: int
    start: float
    end: float


class Beside(NamedTuple):
    """A side of an end of contact, `direction` 1 or -1 along the boundary, with what is proved there.

    `farthest` is the distance from the end up to which the gap, or the contact, goes on on this side.
    """

    side: int
    place: float
    direction: int
    verdict: Verdict
    farthest: float


def measure_certain(study: Mapping[str, Any], contact: str) -> None:
    """Write the table of all cases and sizes."""
    sizes = [parse_real(h, "certain.h") for h in study["h"]]
    case_tables = []
    for case in chain.from_iterable(map(scenes.load_cases, study["scenes"])):
        levels = [measure(case, h) for h in sizes]
        case_tables.append(xr.concat(levels, "mesh").assign_coords(case=case.name))
        print(f"{case.name} measured")
    table = xr.concat(case_tables, "case", join="outer").assign_coords(h=("mesh", sizes))
    tables.save_table(table, contact, "certain", {"certain": study})


def measure(case: ExactSolution, h: float) -> xr.Dataset:
    """Lengths and contradictions on one mesh, and over `beside` the distances with their orders."""
    solution = Solver(case.problem, h=h, H=2 * h)()
    contact = find_contact(case)
    arcs = solution.contact.certain
    beside = list_beside_ends(case, contact)
    undecided = sum(arc.end - arc.start for arc in arcs if arc.verdict is Verdict.UNDECIDED)
    values: dict[str, Any] = {
        "undecided_length": undecided,
        "undecided_share": undecided / sum(arc.end - arc.start for arc in arcs),
        "contradictions": count_contradictions(arcs, contact),
        "contradictions_of_raised": count_contradictions(decide_for_raised(solution), contact),
        "proved_distance": ("beside", [find_proved_distance(arcs, place) for place in beside]),
        "proved_order": ("beside", [expect_order(case, place) for place in beside]),
    }
    names = [f"{p.side}: {p.place:.4g}, {p.verdict}" for p in beside]
    return xr.Dataset(values, coords={"beside": names})


def find_contact(case: ExactSolution) -> list[ExactContact]:
    """The exact contact set."""
    lengths = case.polygon.lengths
    contact = certify_case(case).contact
    return [ExactContact(side, start * lengths[side], end * lengths[side]) for side, start, end in contact]


def count_contradictions(arcs: Sequence[CertainArc], contact: Sequence[ExactContact]) -> int:
    """How many arcs are proved free and meet the contact set, or proved to touch and do not meet it."""
    wrong = 0
    for arc in arcs:
        meets = any(c.side == arc.side and c.start <= arc.end and c.end >= arc.start for c in contact)
        wrong += arc.verdict is (Verdict.FREE if meets else Verdict.TOUCHES)
    return wrong


def decide_for_raised(solution: Solution) -> list[CertainArc]:
    """The arcs of a u_h that is too high for its bounds, with a lambda_H without contact."""
    d = solution.bounded
    bound = d.local_bound
    assert d.data is not None
    assert bound is not None
    u_h = d.u_h + RISE_OVER_BOUND * bound.u
    return find_certain_contact(d.data, d.partition, u_h, np.zeros_like(d.lambda_H), d.form, bound)


def list_beside_ends(case: ExactSolution, contact: Sequence[ExactContact]) -> list[Beside]:
    """Both sides of each end of contact that lies inside a side of the polygon."""
    beside = []
    for interval in contact:
        length = float(case.polygon.lengths[interval.side])
        for place, direction in ((interval.start, -1), (interval.end, 1)):
            if 0 < place < length:
                outside = place if direction < 0 else length - place
                inside = interval.end - interval.start
                beside.append(Beside(interval.side, place, direction, Verdict.FREE, outside))
                beside.append(Beside(interval.side, place, -direction, Verdict.TOUCHES, inside))
    return beside


def find_proved_distance(arcs: Sequence[CertainArc], beside: Beside) -> float:
    """The distance from an end of contact within which nothing is proved.

    That to the nearest arc that is free, or to the far end of the nearest arc that touches; or the distance
    to the next end if no arc is nearer.
    """
    distances = [beside.farthest]
    for arc in arcs:
        if arc.side == beside.side and arc.verdict is beside.verdict:
            ends = [beside.direction * (s - beside.place) for s in (arc.start, arc.end)]
            distance = min(ends) if beside.verdict is Verdict.FREE else max(ends)
            if distance >= 0:
                distances.append(distance)
    return min(distances)


def expect_order(case: ExactSolution, beside: Beside) -> float:
    """1/gamma or 1/(1 + alpha), from the gap or lambda at two points beside the end of contact."""

    def evaluate(distance: float) -> Array:
        """The flux or the gap at this distance from the end."""
        s = beside.place + beside.direction * distance
        _, flux, gap = case.trace_flux_and_gap(np.array([beside.side]), np.array([s]))
        return flux if beside.verdict is Verdict.TOUCHES else gap

    step = EXPONENT_STEP * float(case.polygon.lengths[beside.side])
    exponent = math.log2(float(evaluate(2 * step)[0] / evaluate(step)[0]))
    return round(1 / (exponent + (beside.verdict is Verdict.TOUCHES)), ORDER_DIGITS)
