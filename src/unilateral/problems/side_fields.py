"""The fields of a problem that are given by sides: free_sides, g, q and u, with formulas in x and y."""

from __future__ import annotations

import re
from collections.abc import Collection
from fractions import Fraction
from typing import Any

from unilateral.errors import InputError, shown
from unilateral.formulas.expression import ZERO, Expression, atoms_in, has_log, variable
from unilateral.formulas.expression import number as exact
from unilateral.formulas.formula import kinks, parse, substituted
from unilateral.formulas.grammar import JUMP, KINK, NO_LOG
from unilateral.geometry.polygon import Polygon
from unilateral.problems import arguments
from unilateral.system.declarations import INTEGER

JOINED = re.compile(r"([-+]?\d+):(\S+)")
"""A side and its formula that YAML reads as one text, for want of a blank."""
Ends = tuple[list[Expression], list[Expression]]
NOTHING = ("none", "null", "nil")
"""What people write for no formula, in small or large letters."""
INSTEAD = {
    "f": "write 0 where there is none",
    "g": "in a list write null for a side that is named in free_sides or in u",
    "q": "write 0 where there is none, or in a list null",
    "u": "write what u is there, such as 0, or leave the side out",
}
"""What to write in place of such a word."""


def without_contact(of: dict[str, Any], n: int, where: str) -> tuple[tuple[int, ...], dict[int, Any]]:
    """The free sides of n, and what u is on each clamped one, in their order.

    Raises InputError, beginning with `where`, for what is no side, is given twice or is both.
    """
    given, of_free = of.get("u", {}), f"{where}, field free_sides"
    free = arguments.sides(of.get("free_sides"), n, of_free)
    for key in given:
        if isinstance(key, str) and (joined := JOINED.fullmatch(key)):
            blank = f"the colon in '{shown(key)}' needs a blank after it"
            raise InputError(f"{where}, field u: {blank}; write {{{shown(': '.join(joined.groups()))}}}")
    keys = [int(key) if INTEGER.match(key) else key for key in given]
    clamped = dict(zip(arguments.sides(keys, n, f"{where}, field u"), given.values(), strict=True))
    for side in {*free} & {*clamped}:
        raise InputError(f"{of_free}: side {side} is clamped; remove it from free_sides or from u")
    return tuple(sorted(free)), dict(sorted(clamped.items()))


def on_sides(
    field: str, given: Any, ends: list[Ends], free: Collection[int], clamped: Collection[int], where: str
) -> list[Expression]:
    """The field g or q on every side as a formula in x, y, 0 on sides without one; see `problem_file.made`.

    One formula is for all sides that have one. The sides lie between the `ends`.
    """
    n, listed = len(ends), isinstance(given, list)
    on = {*free} if field == "q" else {*range(n)} - {*free, *clamped}
    if field == "g" and given is None and on:
        raise InputError(
            f"{where}: it is missing, and side {min(on)} is neither free nor clamped; write one formula for "
            "all sides, or a list with one per side"
        )
    if listed and len(given) != n:
        raise InputError(f"{where}: {len(given)} formulas for {n} sides; give one for all, or one per side")
    texts = enumerate(given if listed else [])
    read = [_listed(field, text, side, on, clamped, f"{where}[{side}]") for side, text in texts]
    read = read or [plain(given, where, field)] * n
    if field == "q" and not (listed or free) and read[0].rational != 0:
        raise InputError(f"{where}: no side is free; name the sides with a given flux in free_sides")
    if field == "g":
        read = [trace(read[side], ends[side], side, where) if side in on else ZERO for side in range(n)]
    return [formula if side in on else ZERO for side, formula in enumerate(read)]


def _listed(
    field: str, text: object, side: int, on: Collection[int], clamped: Collection[int], where: str
) -> Expression:
    """A formula of a list. Raises InputError for one that its side cannot have, and where one is missing."""
    if text is not None and side in clamped:
        raise InputError(f"{where}: side {side} is clamped; write null, or take it out of u")
    if text is not None and field == "g" and side not in on:
        raise InputError(f"{where}: side {side} is free; write null, or take it out of free_sides")
    if text is not None and field == "q" and side not in on:
        raise InputError(f"{where}: side {side} is not free; write null, or name it in free_sides")
    if text is None and field == "g" and side in on:
        raise InputError(
            f"{where}: there is no formula, and side {side} is neither free nor clamped; write one, or name "
            "the side in free_sides or in u"
        )
    return plain(text, where, field)


def trace(formula: Expression, ends: Ends, side: int, where: str) -> Expression:
    """g or u on a side between two `ends`, a formula in x, y that is Lipschitz there, or InputError."""
    if not atoms_in(formula, "pos"):
        return formula
    (x0, y0), (x1, y1) = ends
    t = variable("t")
    on_side = {"x": x0 + t * (x1 - x0), "y": y0 + t * (y1 - y0)}
    along = substituted(formula, on_side, f"{where}, on side {side}")
    try:
        powers = [k for t, k in kinks(along, "t") if 0 <= t <= 1]
    except ValueError as error:
        raise InputError(f"{where}: {error}") from None
    if any(k < 1 for k in powers):
        raise InputError(
            f"{where}: on side {side} a power of pos is below 1; a Lipschitz function has 1 or more"
        )
    return formula


def ends_of(polygon: Polygon) -> list[Ends]:
    """The exact coordinates of the two ends of every side."""
    vertices = [[exact(Fraction(repr(x))) for x in vertex] for vertex in polygon.vertices.tolist()]
    return [*zip(vertices, vertices[1:] + vertices[:1], strict=True)]


def plain(text: object, where: str, field: str) -> Expression:
    """A formula in x, y without logarithms, 0 for None; see `problem_file.check_roots` for its roots.

    Raises InputError for a word that says that there is no formula, too.
    """
    if isinstance(text, str) and text.strip().lower() in NOTHING:
        raise InputError(f"{where}: '{text}' is no formula; {INSTEAD[field]}")
    least_power = KINK if field in "gu" else JUMP
    formula = parse(0 if text is None else text, ("x", "y"), where, least_power)
    if has_log(formula):
        raise InputError(f"{where}: {NO_LOG}")
    return formula
