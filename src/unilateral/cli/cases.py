"""The catalogue of cases, each with its certificate, as text and for programs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from unilateral.geometry import polygon
from unilateral.geometry.polygon import Polygon
from unilateral.problems import case
from unilateral.problems.case import Case
from unilateral.problems.case_certificate import ROUND_OFF, Certificate, certify

MOST_INTERVALS = 4


def listing() -> Iterator[str]:
    """A heading, and two lines or more for each case; cases are certified one by one."""
    yield f"{'case':15} {'(j)':4} {'(jj)':5} {'(jjj)':6} {'lambda <=':10} {'u - g <=':9} {'contact':31} on"
    for name in case.names():
        for found, certificate in certified(name, domains(name)):
            holds = ["yes" if value else "no" for value in certificate.hypotheses.values()]
            flux, gap = largest(certificate)
            row = f"{flux:<10.3g} {gap:<9.3g} {contact(certificate.contact):31} {found.polygon.name}"
            yield f"{name:15} {holds[0]:4} {holds[1]:5} {holds[2]:6} {row}"
        yield f"{'':15} {case.declared(name)[0]['title']}"


def records() -> dict[str, Any]:
    """The catalogue for programs."""
    return {"cases": [_record(name) for name in case.names()]}


def _record(name: str) -> dict[str, Any]:
    on = [polygon_record(*found) for found in certified(name, domains(name))]
    return {"name": name, "title": case.declared(name)[0]["title"], "polygons": on}


def polygon_record(found: Case, certificate: Certificate) -> dict[str, Any]:
    """The certificate of a case on a polygon; contact by arc lengths from the start of each side."""
    lengths, (flux, gap) = found.polygon.lengths.tolist(), largest(certificate)
    intervals = [
        {"side": side, "start": start * lengths[side], "end": end * lengths[side]}
        for side, start, end in certificate.contact
    ]
    return {
        "polygon": found.polygon.name,
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


def certified(name: str, on: Sequence[Polygon], side: int = 0) -> Iterator[tuple[Case, Certificate]]:
    """The case on a side of each polygon, with its certificate."""
    for domain in on:
        found = case.load(name, domain, side)
        yield found, certify(found)


def largest(certificate: Certificate) -> tuple[float, float]:
    """The largest values of lambda and of the gap; 0 for what is rounding."""
    flux, gap = (x if x > ROUND_OFF else 0.0 for x in (certificate.lambda_max, certificate.gap_max))
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
