"""The catalogue of cases as text, each with its certificate."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from unilateral.geometry import polygon
from unilateral.problems import case
from unilateral.problems.certificate import ROUND_OFF, certify

MOST_INTERVALS = 4


def listing() -> Iterator[str]:
    """A head, and two lines or more a case; certified one by one."""
    yield f"{'case':15} {'(j)':4} {'(jj)':5} {'(jjj)':6} {'lambda <=':10} {'u - g <=':9} {'contact':31} on"
    for name in case.names():
        declaration, _ = case.declared(name)
        polygons = polygon.names() if declaration["polygons"] == "any" else declaration["polygons"]
        for domain in polygons:
            certificate = certify(case.load(name, polygon.named(domain)))
            holds = ["yes" if value else "no" for value in certificate.hypotheses.values()]
            flux, gap = (x if x > ROUND_OFF else 0 for x in (certificate.lambda_max, certificate.gap_max))
            row = f"{flux:<10.3g} {gap:<9.3g} {contact(certificate.contact):31} {domain}"
            yield f"{name:15} {holds[0]:4} {holds[1]:5} {holds[2]:6} {row}"
        yield f"{'':15} {declaration['title']}"


def contact(intervals: Sequence[tuple[int, float, float]]) -> str:
    """The contact set in words."""
    whole = [side for side, start, end in intervals if (start, end) == (0.0, 1.0)]
    parts = [f"{side}: {start:.3g}-{end:.3g}" for side, start, end in intervals if side not in whole]
    if len(parts) > MOST_INTERVALS:
        parts = [f"{len(parts)} intervals"]
    if whole:
        parts.append(f"sides {', '.join(map(str, whole))}")
    return "; ".join(parts) or "none"
