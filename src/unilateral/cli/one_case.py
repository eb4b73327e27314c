"""One case of `unilateral cases`: its formulas on each polygon, and what is known of it."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator
from typing import Any

from unilateral.cli.cases import MOST_INTERVALS, certified, domains, polygon_record
from unilateral.exchange.case_formulas import DEFINITIONS, NO_FORMULAS, formulas, module
from unilateral.exchange.score import PROVED
from unilateral.problems import problem_file
from unilateral.problems.case import Case
from unilateral.problems.case_certificate import Certificate
from unilateral.problems.polar_atoms import Polar
from unilateral.system.as_json import text as as_text

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


def shown(name: str, polygon: str | None, side: int, kind: str) -> str:
    """The case on that polygon, or on all that it is for, in the format of that kind.

    Raises InputError for an unknown case or polygon, and where there is no such format of it.
    """
    on = domains(name) if polygon is None else [problem_file.polygon_of(polygon)]
    if kind in ("python", "ufl"):
        ((found, _),) = certified(name, on[:1], side)
        return module(found, kind).rstrip()
    each = list(certified(name, on, side))
    return as_text(record(each)) if kind == "json" else "\n".join(lines(each))


def record(on: list[tuple[Case, Certificate]]) -> dict[str, Any]:
    """What `lines` says, for programs."""
    first = on[0][0]
    return {
        "name": first.name,
        **{name: first.declaration.get(name) for name in ("title", "about", "asymptotic")},
        "regularity": regularity(first),
        "proved_rates": proved(first),
        "definitions": DEFINITIONS,
        "polygons": [
            polygon_record(of, certificate)
            | {"vertices": of.polygon.vertices.tolist(), "powers": powers(of), **formulas(of)}
            for of, certificate in on
        ],
    }


def proved(of: Case) -> dict[str, float] | None:
    """The rates of Theorem 4.1, None where it does not apply."""
    return PROVED if all(of.declaration["hypotheses"].values()) else None


def lines(on: list[tuple[Case, Certificate]]) -> Iterator[str]:
    """What is known of a case, in lines for readers."""
    first, certificate = on[0]
    declared = first.declaration
    yield f"{first.name}: {declared['title']}"
    yield textwrap.fill(declared.get("about", ""), WIDTH, initial_indent="  ", subsequent_indent="  ")
    for each in on:
        yield from _on_polygon(*each)
    held = (
        f"({name}) {'holds' if holds else 'does not hold'}" for name, holds in certificate.hypotheses.items()
    )
    yield f"hypotheses of Theorem 4.1: {', '.join(held)}"
    yield f"u - g in H^(3/2) on every side: {'yes' if certificate.g_regular else 'no'}"
    known = [what if regularity(first)[name] else f"not {what}" for name, what in REGULARITY.items()]
    yield f"regularity: {', '.join(known)}"
    rates = proved(first)
    said = ", ".join(f"{rates[norm]:g} {what}" for norm, what in RATES.items()) if rates else "none"
    yield f"proved rates: {said}"
    begins = ", ".join(f"{norm} from h = {declared['asymptotic'][norm]['from']}" for norm in RATES)
    yield f"asymptotic: {begins}"
    yield LEGEND


def _on_polygon(of: Case, certificate: Certificate) -> Iterator[str]:
    found, polygon, intervals = formulas(of), of.polygon, polygon_record(of, certificate)["contact"]
    closed = found["u"] is not None
    yield f"on {polygon.name}:"
    yield from (f"  {name} = {found[name]}" for name in "uf") if closed else (f"  {NO_FORMULAS}",)
    yield from ("  u is like r^({exponent}) at ({x:.6g}, {y:.6g})".format(**each) for each in powers(of))
    for side, (gap, flux) in enumerate(zip(found["gap"], found["lambda"], strict=True)):
        (a, b), (c, d) = polygon.point(side, 0), polygon.point(side, 1)
        at = [each for each in intervals if each["side"] == side]
        yield f"  side {side}, ({a:.6g}, {b:.6g}) to ({c:.6g}, {d:.6g}), {_contact(at)}"
        if closed:
            yield f"    g = {'u' if gap == '0' else f'u - ({gap})'}"
            yield f"    lambda = {flux if at else 0}"


def _contact(intervals: list[dict[str, float]]) -> str:
    if len(intervals) > MOST_INTERVALS:
        return f"contact on {len(intervals)} intervals"
    return "contact " + (", ".join("{start:.6g} to {end:.6g}".format(**each) for each in intervals) or "none")


def regularity(of: Case) -> dict[str, bool]:
    """The regularity of u and lambda: what all atoms have."""
    return {name: all(getattr(atom.regularity, name) for atom in of.atoms) for name in REGULARITY}


def powers(of: Case) -> list[dict[str, Any]]:
    """The points (x, y) about which u is like a fractional power of the distance."""
    atoms = [atom for atom in of.atoms if isinstance(atom, Polar)]
    return [
        {"x": float(x), "y": float(y), "exponent": str(atom.beta)} for atom in atoms for x, y in [atom.centre]
    ]
