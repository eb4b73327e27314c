"""The catalogue of cases with their certificates, and one case with its formulas: as text, for programs."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Sequence
from typing import Any

from unilateral.exchange.case_formulas import DEFINITIONS, NO_FORMULAS, formulas, module
from unilateral.geometry import polygon
from unilateral.geometry.polygon import Polygon
from unilateral.problems import case, problem_file
from unilateral.problems.case import ExactSolution
from unilateral.problems.case_certificate import PROVED, ROUND_OFF, Certificate, certify
from unilateral.problems.polar_atoms import Polar
from unilateral.system.as_json import text as as_text

MOST_INTERVALS = 4
WIDTH = 100
LEGEND = (
    "pos(a, k) is the positive part of a to the power k, angle(b, a) the angle of (a, b) in [0, 2 pi); "
    "contact is in arc length from the start of the side"
)
RATES = {
    "h1": "of u in H1 by (4.11)",
    "hm12": "of lambda in H^(-1/2) by (4.12)",
    "l2": "of lambda in L2 by (4.13)",
}
REGULARITY = {
    "in_H2": "u in H2",
    "lipschitz": "u Lipschitz on the sides",
    "flux_in_L2": "lambda in L2",
    "flux_bounded": "lambda bounded",
    "finite": "finitely many ends of contact",
}


def listing() -> Iterator[str]:
    """A heading, and two lines or more for each case; cases are certified one by one."""
    yield f"{'case':15} {'(j)':4} {'(jj)':5} {'(jjj)':6} {'lambda <=':10} {'u - g <=':9} {'contact':31} on"
    for name in case.names():
        for solution, certificate in certify_on(name, domains(name)):
            holds = ["yes" if value else "no" for value in certificate.hypotheses.values()]
            flux, gap = largest(certificate)
            row = f"{flux:<10.3g} {gap:<9.3g} {contact(certificate.contact):31} {solution.polygon.name}"
            yield f"{name:15} {holds[0]:4} {holds[1]:5} {holds[2]:6} {row}"
        yield f"{'':15} {case.declared(name)[0]['title']}"


def records() -> dict[str, Any]:
    """The catalogue for programs."""
    return {
        "cases": [
            {
                "name": name,
                "title": case.declared(name)[0]["title"],
                "polygons": [polygon_record(*pair) for pair in certify_on(name, domains(name))],
            }
            for name in case.names()
        ]
    }


def polygon_record(solution: ExactSolution, certificate: Certificate) -> dict[str, Any]:
    """The certificate of a case on a polygon; contact by arc lengths from the start of each side."""
    lengths = solution.polygon.lengths.tolist()
    flux, gap = largest(certificate)
    intervals = [
        {"side": side, "start": start * lengths[side], "end": end * lengths[side]}
        for side, start, end in certificate.contact
    ]
    return {
        "polygon": solution.polygon.name,
        "hypotheses": certificate.hypotheses,
        "g_regular": certificate.g_regular,
        "contact": intervals,
        "lambda_max": flux,
        "gap_max": gap,
    }


def domains(name: str) -> list[Polygon]:
    """The named polygons that a case is for."""
    declared = case.declared(name)[0]["polygons"]
    return [polygon.named(each) for each in (polygon.names() if declared == "any" else declared)]


def certify_on(
    name: str, polygons: Sequence[Polygon], side: int = 0
) -> Iterator[tuple[ExactSolution, Certificate]]:
    """The case on a side of each polygon, with its certificate."""
    for domain in polygons:
        solution = case.load(name, domain, side)
        yield solution, certify(solution)


def largest(certificate: Certificate) -> tuple[float, float]:
    """The largest values of lambda and of the gap; 0 for what is rounding."""
    flux = certificate.lambda_max if certificate.lambda_max > ROUND_OFF else 0.0
    gap = certificate.gap_max if certificate.gap_max > ROUND_OFF else 0.0
    return flux, gap


def contact(intervals: Sequence[tuple[int, float, float]]) -> str:
    """The contact set in words."""
    whole = [side for side, start, end in intervals if (start, end) == (0.0, 1.0)]
    parts = [f"{side}: {start:.3g}-{end:.3g}" for side, start, end in intervals if side not in whole]
    if len(parts) > MOST_INTERVALS:
        parts = [f"{len(parts)} intervals"]
    if whole:
        parts.append(f"sides {', '.join(map(str, whole))}")
    return "; ".join(parts) or "none"


def show(name: str, polygon: str | None, side: int, kind: str) -> str:
    """The case on that polygon, or on all that it is for, in the format of that kind.

    Raises InputError for an unknown case or polygon, and where there is no such format of it.
    """
    polygons = domains(name) if polygon is None else [problem_file.polygon_of(polygon)]
    if kind in ("python", "ufl"):
        solution, _ = next(certify_on(name, polygons, side))
        return module(solution, kind).rstrip()
    pairs = list(certify_on(name, polygons, side))
    return as_text(record(pairs)) if kind == "json" else "\n".join(lines(pairs))


def record(pairs: list[tuple[ExactSolution, Certificate]]) -> dict[str, Any]:
    """What `lines` says, for programs."""
    first = pairs[0][0]
    return {
        "name": first.name,
        **{name: first.declaration.get(name) for name in ("title", "about", "asymptotic")},
        "regularity": regularity(first),
        "proved_rates": proved_rates(first),
        "definitions": DEFINITIONS,
        "polygons": [
            polygon_record(solution, certificate)
            | {"vertices": solution.polygon.vertices.tolist(), "powers": powers(solution)}
            | formulas(solution)
            for solution, certificate in pairs
        ],
    }


def proved_rates(solution: ExactSolution) -> dict[str, float] | None:
    """The rates of Theorem 4.1, None where it does not apply."""
    return PROVED if all(solution.declaration["hypotheses"].values()) else None


def lines(pairs: list[tuple[ExactSolution, Certificate]]) -> Iterator[str]:
    """What is known of a case, in lines for readers."""
    first, certificate = pairs[0]
    declared = first.declaration
    yield f"{first.name}: {declared['title']}"
    yield textwrap.fill(declared.get("about", ""), WIDTH, initial_indent="  ", subsequent_indent="  ")
    for pair in pairs:
        yield from _on_polygon(*pair)
    hypotheses = (
        f"({name}) {'holds' if holds else 'does not hold'}" for name, holds in certificate.hypotheses.items()
    )
    yield f"hypotheses of Theorem 4.1: {', '.join(hypotheses)}"
    yield f"u - g in H^(3/2) on every side: {'yes' if certificate.g_regular else 'no'}"
    known = [what if regularity(first)[name] else f"not {what}" for name, what in REGULARITY.items()]
    yield f"regularity: {', '.join(known)}"
    rates = proved_rates(first)
    texts = [f"{rates[norm]:g} {what}" for norm, what in RATES.items()] if rates else ["none"]
    yield f"proved rates: {', '.join(texts)}"
    begins = ", ".join(f"{norm} from h = {declared['asymptotic'][norm]['from']}" for norm in RATES)
    yield f"asymptotic: {begins}"
    yield LEGEND


def _on_polygon(solution: ExactSolution, certificate: Certificate) -> Iterator[str]:
    """The formulas on a polygon, and contact side by side."""
    polygon = solution.polygon
    texts = formulas(solution)
    has_formulas = texts["u"] is not None
    yield f"on {polygon.name}:"
    if has_formulas:
        yield f"  u = {texts['u']}"
        yield f"  f = {texts['f']}"
    else:
        yield f"  {NO_FORMULAS}"
    for power in powers(solution):
        yield "  u is like r^({exponent}) at ({x:.6g}, {y:.6g})".format(**power)
    contact_set = polygon_record(solution, certificate)["contact"]
    for side, (gap, flux) in enumerate(zip(texts["gap"], texts["lambda"], strict=True)):
        (a, b) = polygon.point(side, 0)
        (c, d) = polygon.point(side, 1)
        intervals = [interval for interval in contact_set if interval["side"] == side]
        is_clamped = side in solution.clamped_sides
        if is_clamped:
            kind = "clamped: u is given there"
        elif len(intervals) > MOST_INTERVALS:
            kind = f"contact on {len(intervals)} intervals"
        else:
            ends = ["{start:.6g} to {end:.6g}".format(**interval) for interval in intervals]
            kind = f"contact {', '.join(ends) or 'none'}"
        yield f"  side {side}, ({a:.6g}, {b:.6g}) to ({c:.6g}, {d:.6g}), {kind}"
        if has_formulas and not is_clamped:
            yield f"    g = {'u' if gap == '0' else f'u - ({gap})'}"
            yield f"    lambda = {flux if intervals else 0}"


def regularity(solution: ExactSolution) -> dict[str, bool]:
    """The regularity of u and lambda: what all atoms have."""
    return {name: all(getattr(atom.regularity, name) for atom in solution.atoms) for name in REGULARITY}


def powers(solution: ExactSolution) -> list[dict[str, Any]]:
    """The points (x, y) about which u is like a fractional power of the distance."""
    return [
        {"x": float(atom.centre[0]), "y": float(atom.centre[1]), "exponent": str(atom.beta)}
        for atom in solution.atoms
        if isinstance(atom, Polar)
    ]
