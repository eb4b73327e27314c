"""The catalogue of cases with their certificates, and one case with its formulas: as text, for programs."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Sequence
from typing import Any

from unilateral.exchange.case_formulas import (
    DEFINITIONS,
    NO_FORMULAS,
    derive_case_formulas,
    render_case_module,
)
from unilateral.geometry import polygon
from unilateral.geometry.polygon import Polygon
from unilateral.problems import case, problem_file
from unilateral.problems.case import ExactSolution
from unilateral.problems.case_certificate import CASE_ROUND_OFF, PROVED_RATES, CaseCertificate, certify_case
from unilateral.problems.polar_atoms import PolarAtom
from unilateral.system.json_records import encode_json

MAX_PRINTED_INTERVALS = 4
TEXT_WIDTH = 100
FORMULA_LEGEND = (
    "pos(a, k) is the positive part of a to the power k, angle(b, a) the angle of (a, b) in [0, 2 pi); "
    "contact is in arc length from the start of the side"
)
RATE_TEXTS = {
    "h1": "of u in H1 by (4.11)",
    "hm12": "of lambda in H^(-1/2) by (4.12)",
    "l2": "of lambda in L2 by (4.13)",
}
REGULARITY_TEXTS = {
    "in_H2": "u in H2",
    "lipschitz": "u Lipschitz on the sides",
    "flux_in_L2": "lambda in L2",
    "flux_bounded": "lambda bounded",
    "finite": "finitely many ends of contact",
}


def list_cases() -> Iterator[str]:
    """A heading, and two lines or more for each case; cases are certified one by one."""
    yield f"{'case':15} {'(j)':4} {'(jj)':5} {'(jjj)':6} {'lambda <=':10} {'u - g <=':9} {'contact':31} on"
    for name in case.case_names():
        for solution, certificate in certify_on_polygons(name, list_case_polygons(name)):
            holds = ["yes" if value else "no" for value in certificate.hypotheses.values()]
            flux, gap = largest_flux_and_gap(certificate)
            contact = describe_contact(certificate.contact)
            row = f"{flux:<10.3g} {gap:<9.3g} {contact:31} {solution.polygon.name}"
            yield f"{name:15} {holds[0]:4} {holds[1]:5} {holds[2]:6} {row}"
        yield f"{'':15} {case.read_case_declaration(name)[0]['title']}"


def make_catalogue_record() -> dict[str, Any]:
    """The catalogue for programs."""
    return {
        "cases": [
            {
                "name": name,
                "title": case.read_case_declaration(name)[0]["title"],
                "polygons": [
                    make_polygon_record(*pair) for pair in certify_on_polygons(name, list_case_polygons(name))
                ],
            }
            for name in case.case_names()
        ]
    }


def make_polygon_record(solution: ExactSolution, certificate: CaseCertificate) -> dict[str, Any]:
    """The certificate of a case on a polygon; contact by arc lengths from the start of each side."""
    lengths = solution.polygon.lengths.tolist()
    flux, gap = largest_flux_and_gap(certificate)
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


def list_case_polygons(name: str) -> list[Polygon]:
    """The named polygons that a case is for."""
    declared = case.read_case_declaration(name)[0]["polygons"]
    return [
        polygon.find_polygon(polygon_name)
        for polygon_name in (polygon.polygon_names() if declared == "any" else declared)
    ]


def certify_on_polygons(
    name: str, polygons: Sequence[Polygon], side: int = 0
) -> Iterator[tuple[ExactSolution, CaseCertificate]]:
    """The case on a side of each polygon, with its certificate."""
    for domain in polygons:
        solution = case.load_solution(name, domain, side)
        yield solution, certify_case(solution)


def largest_flux_and_gap(certificate: CaseCertificate) -> tuple[float, float]:
    """The largest values of lambda and of the gap, 0 where they are rounding."""
    flux = certificate.max_multiplier if certificate.max_multiplier > CASE_ROUND_OFF else 0.0
    gap = certificate.max_gap if certificate.max_gap > CASE_ROUND_OFF else 0.0
    return flux, gap


def describe_contact(intervals: Sequence[tuple[int, float, float]]) -> str:
    """The contact set in words."""
    full_sides = [side for side, start, end in intervals if (start, end) == (0.0, 1.0)]
    texts = [f"{side}: {start:.3g}-{end:.3g}" for side, start, end in intervals if side not in full_sides]
    if len(texts) > MAX_PRINTED_INTERVALS:
        texts = [f"{len(texts)} intervals"]
    if full_sides:
        texts.append(f"sides {', '.join(map(str, full_sides))}")
    return "; ".join(texts) or "none"


def render_case(name: str, polygon: str | None, side: int, text_format: str) -> str:
    """The case on a polygon, or on all that it is for, as text in a format.

    Raises InputError for an unknown case or polygon, and where there is no such format of it.
    """
    polygons = list_case_polygons(name) if polygon is None else [problem_file.load_polygon(polygon)]
    if text_format in ("python", "ufl"):
        solution, _ = next(certify_on_polygons(name, polygons, side))
        return render_case_module(solution, text_format).rstrip()
    pairs = list(certify_on_polygons(name, polygons, side))
    return encode_json(make_case_record(pairs)) if text_format == "json" else "\n".join(describe_case(pairs))


def make_case_record(certified_cases: list[tuple[ExactSolution, CaseCertificate]]) -> dict[str, Any]:
    """Record of a case on its polygons for programs: formulas, regularity, rates and contact."""
    first = certified_cases[0][0]
    return {
        "name": first.name,
        **{name: first.declaration.get(name) for name in ("title", "about", "asymptotic")},
        "regularity": case_regularity(first),
        "proved_rates": proved_rates(first),
        "definitions": DEFINITIONS,
        "polygons": [
            make_polygon_record(solution, certificate)
            | {"vertices": solution.polygon.vertices.tolist(), "powers": fractional_powers(solution)}
            | derive_case_formulas(solution)
            for solution, certificate in certified_cases
        ],
    }


def proved_rates(solution: ExactSolution) -> dict[str, float] | None:
    """The rates of Theorem 4.1 by norm, None where it does not apply."""
    return PROVED_RATES if all(solution.declaration["hypotheses"].values()) else None


def describe_case(certified_cases: list[tuple[ExactSolution, CaseCertificate]]) -> Iterator[str]:
    """Lines that describe a case on its polygons for readers."""
    first, certificate = certified_cases[0]
    declared = first.declaration
    yield f"{first.name}: {declared['title']}"
    yield textwrap.fill(declared.get("about", ""), TEXT_WIDTH, initial_indent="  ", subsequent_indent="  ")
    for pair in certified_cases:
        yield from _describe_on_polygon(*pair)
    hypotheses = (
        f"({name}) {'holds' if holds else 'does not hold'}" for name, holds in certificate.hypotheses.items()
    )
    yield f"hypotheses of Theorem 4.1: {', '.join(hypotheses)}"
    yield f"u - g in H^(3/2) on every side: {'yes' if certificate.g_regular else 'no'}"
    regularity = [
        text if case_regularity(first)[name] else f"not {text}" for name, text in REGULARITY_TEXTS.items()
    ]
    yield f"regularity: {', '.join(regularity)}"
    rates = proved_rates(first)
    texts = [f"{rates[norm]:g} {text}" for norm, text in RATE_TEXTS.items()] if rates else ["none"]
    yield f"proved rates: {', '.join(texts)}"
    begins = ", ".join(f"{norm} from h = {declared['asymptotic'][norm]['from']}" for norm in RATE_TEXTS)
    yield f"asymptotic: {begins}"
    yield FORMULA_LEGEND


def _describe_on_polygon(solution: ExactSolution, certificate: CaseCertificate) -> Iterator[str]:
    """The formulas on a polygon, and contact side by side."""
    polygon = solution.polygon
    texts = derive_case_formulas(solution)
    has_formulas = texts["u"] is not None
    yield f"on {polygon.name}:"
    if has_formulas:
        yield f"  u = {texts['u']}"
        yield f"  f = {texts['f']}"
    else:
        yield f"  {NO_FORMULAS}"
    for power in fractional_powers(solution):
        yield "  u is like r^({exponent}) at ({x:.6g}, {y:.6g})".format(**power)
    contact_set = make_polygon_record(solution, certificate)["contact"]
    for side, (gap, flux) in enumerate(zip(texts["gap"], texts["lambda"], strict=True)):
        ends = ["({:.6g}, {:.6g})".format(*polygon.point(side, t)) for t in (0, 1)]
        intervals = [interval for interval in contact_set if interval["side"] == side]
        is_clamped = side in solution.clamped_sides
        kind = "clamped: u is given there" if is_clamped else f"contact {_list_intervals(intervals)}"
        yield f"  side {side}, {' to '.join(ends)}, {kind}"
        if has_formulas and not is_clamped:
            yield f"    g = {'u' if gap == '0' else f'u - ({gap})'}"
            yield f"    lambda = {flux if intervals else 0}"


def _list_intervals(intervals: list[dict[str, float]]) -> str:
    """The ends of the intervals, or their number if there are many."""
    if len(intervals) > MAX_PRINTED_INTERVALS:
        return f"on {len(intervals)} intervals"
    return ", ".join("{start:.6g} to {end:.6g}".format(**interval) for interval in intervals) or "none"


def case_regularity(solution: ExactSolution) -> dict[str, bool]:
    """The regularity of u and lambda: what all atoms have."""
    return {name: all(getattr(atom.regularity, name) for atom in solution.atoms) for name in REGULARITY_TEXTS}


def fractional_powers(solution: ExactSolution) -> list[dict[str, Any]]:
    """The points (x, y) about which u is like a fractional power of the distance."""
    return [
        {"x": float(atom.centre[0]), "y": float(atom.centre[1]), "exponent": str(atom.beta)}
        for atom in solution.atoms
        if isinstance(atom, PolarAtom)
    ]
