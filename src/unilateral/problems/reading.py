"""What users give for f, g, q and u, read: formulas in x and y, functions, or arrays at nodes."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from fractions import Fraction
from numbers import Number

from unilateral.arrays import Array
from unilateral.errors import InputError, shown
from unilateral.formulas.expression import ZERO, Expression, atoms_in, has_log, variable
from unilateral.formulas.expression import number as exact
from unilateral.formulas.formula import kinks, parse, substituted
from unilateral.formulas.grammar import JUMP, KINK, NO_LOG
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.polygon import Polygon
from unilateral.problems import arguments
from unilateral.problems.functions import Function, check_arguments
from unilateral.problems.nodal import at_nodes, is_array, trace
from unilateral.problems.problem import curve
from unilateral.problems.side_models import SideData

Given = str | float | Array | Function | None
"""What a user gives for f, g, q or u: a formula, a number, an array at nodes, a function, or nothing."""
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


def read_source(given: Given, mesh: Mesh | None, where: str) -> Expression | Array | Function:
    """f: a formula in x and y whose kinks can be found, an array at the nodes of the mesh, or a function."""
    f = read_data("f", given, where)
    if is_array(f):
        return at_nodes(mesh, f, where)
    if isinstance(f, Expression):
        for power in atoms_in(f, "pos"):
            try:
                curve(power.args[0])
            except ValueError as error:
                raise InputError(f"{where}: the argument of {power} {error}") from None
    return f


def read_sides(
    field: str,
    given: Given | Sequence[Given],
    ends: list[Ends],
    free: Collection[int],
    clamped: Collection[int],
    mesh: Mesh | None,
    where: str,
) -> list[SideData | Function]:
    """(n sides,) what the field g or q gives on every side, and 0 on sides without one.

    One formula, function or array is for all sides that have one. The sides lie between the `ends`. Arrays
    have a value for each node of the `mesh`. Raises InputError, beginning with `where`.
    """
    n = len(ends)
    sides = {*free} if field == "q" else {*range(n)} - {*free, *clamped}
    if field == "g" and given is None and sides:
        raise InputError(
            f"{where}: it is missing, and side {min(sides)} is neither free nor clamped; write one formula "
            "for all sides, or a list with one per side"
        )
    if isinstance(given, Sequence) and not isinstance(given, str | bytes):
        if len(given) != n:
            raise InputError(
                f"{where}: {len(given)} formulas for {n} sides; give one for all, or one per side"
            )
        places = [f"{where}[{side}]" for side in range(n)]
        data = [read_data(field, *each) for each in zip(given, places, strict=True)]
        for side in range(n):
            _check_listed(field, given[side], side, sides, clamped, places[side])
    else:
        places = [where] * n
        data = [read_data(field, given, where)] * n
        if field == "q" and not free and not (isinstance(data[0], Expression) and data[0].rational == 0):
            raise InputError(f"{where}: no side is free; name the sides with a given flux in free_sides")
    return [
        on_side(field, data[side], side, ends[side], mesh, places[side]) if side in sides else ZERO
        for side in range(n)
    ]


def read_data(field: str, given: object, where: str) -> Expression | Array | Function:
    """What a user gives as a formula, a function or an array, of which only the formula is checked here.

    Raises InputError, beginning with `where`, for what is none of these.
    """
    if callable(given):
        check_arguments(given, where)
        return given
    given = arguments.number(given, where)
    if is_array(given):
        return given
    if given is None or isinstance(given, str | Number):
        return plain(given, where, field)
    raise InputError(
        f"{where}: it is {shown(repr(given))}; it has to be a formula, a function or an array of values "
        "at nodes"
    )


def on_side(
    field: str, data: Expression | Array | Function, side: int, ends: Ends, mesh: Mesh | None, where: str
) -> SideData | Function:
    """The data of a field on a side between two `ends`: g and u are Lipschitz there, arrays become traces."""
    if isinstance(data, Expression):
        return data if field == "q" else lipschitz(data, ends, side, where)
    return data if callable(data) else trace(mesh, data, side, where)


def _check_listed(
    field: str, given: Given, side: int, sides: Collection[int], clamped: Collection[int], where: str
) -> None:
    """Raises InputError for an entry of a list that its side cannot have, and where one is missing."""
    if given is not None and side in clamped:
        raise InputError(f"{where}: side {side} is clamped; write null, or take it out of u")
    if given is not None and field == "g" and side not in sides:
        raise InputError(f"{where}: side {side} is free; write null, or take it out of free_sides")
    if given is not None and field == "q" and side not in sides:
        raise InputError(f"{where}: side {side} is not free; write null, or name it in free_sides")
    if given is None and field == "g" and side in sides:
        raise InputError(
            f"{where}: there is no formula, and side {side} is neither free nor clamped; write one, or name "
            "the side in free_sides or in u"
        )


def lipschitz(formula: Expression, ends: Ends, side: int, where: str) -> Expression:
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


def ends_of_sides(corners: Sequence[list[Expression]]) -> list[Ends]:
    """The exact coordinates of the two ends of every side."""
    return [*zip(corners, [*corners[1:], corners[0]], strict=True)]


def exact_corners(polygon: Polygon) -> list[list[Expression]]:
    """The coordinates of the vertices as exact decimals."""
    return [[exact(Fraction(repr(x))) for x in vertex] for vertex in polygon.vertices.tolist()]


def plain(text: object, where: str, field: str) -> Expression:
    """A formula in x, y without logarithms, 0 for None; see `data_checks.check_roots` for its roots.

    Raises InputError for a word that says that there is no formula, too.
    """
    if isinstance(text, str) and text.strip().lower() in NOTHING:
        raise InputError(f"{where}: '{text}' is no formula; {INSTEAD[field]}")
    least_power = KINK if field in "gu" else JUMP
    formula = parse(0 if text is None else text, ("x", "y"), where, least_power)
    if has_log(formula):
        raise InputError(f"{where}: {NO_LOG}")
    return formula
