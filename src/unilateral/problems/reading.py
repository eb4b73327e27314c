"""What users give for f, g, q and u, read: formulas in x and y, functions, arrays at nodes, or tables."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from fractions import Fraction
from math import hypot
from numbers import Number
from typing import Any

from numpy.typing import ArrayLike

from unilateral.arrays import Array
from unilateral.errors import InputError, quote_input
from unilateral.formulas.exact_numbers import as_float
from unilateral.formulas.expression import ZERO, Expression, find_functions, has_log, variable
from unilateral.formulas.expression import rational_expression as exact
from unilateral.formulas.formula import find_kinks, parse_formula, substitute
from unilateral.formulas.grammar import JUMP_POWER, KINK_POWER, NO_LOG
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.polygon import Polygon
from unilateral.problems import arguments
from unilateral.problems.functions import Function, check_arguments
from unilateral.problems.nodal import check_nodal_values, is_nodal_array, make_trace
from unilateral.problems.problem import zero_curve
from unilateral.problems.side_models import SideData
from unilateral.problems.side_tables import TABLE_SIDE_NEEDED, TableRows, is_table, make_table, read_table

Given = str | float | Array | Function | tuple[ArrayLike, ArrayLike] | Mapping[str, str] | None
"""What a user gives for f, g, q or u: a formula, a number, an array at nodes, a function, or nothing; on a
side also a table, as two arrays or a file."""
ReadData = Expression | Array | Function | TableRows
SideEnds = tuple[list[Expression], list[Expression]]
WORDS_FOR_NONE = ("none", "null", "nil")
"""What people write for no formula, in small or large letters."""
FIELD_SUBSTITUTES = {
    "f": "write 0 where there is none",
    "g": "in a list write null for a side that is named in free_sides or in u",
    "q": "write 0 where there is none, or in a list null",
    "u": "write the value of u, such as 0, or leave the side out",
}
"""What to write in place of such a word."""


def read_source(data: Given, mesh: Mesh | None, where: str) -> Expression | Array | Function:
    """f: a formula in x and y whose kinks can be found, an array at the nodes of the mesh, or a function."""
    f = read_data("f", data, where)
    assert not isinstance(f, TableRows)
    if is_nodal_array(f):
        return check_nodal_values(mesh, f, where)
    if isinstance(f, Expression):
        for power in find_functions(f, "pos"):
            try:
                zero_curve(power.args[0])  # called for its error
            except ValueError as error:
                raise InputError(f"{where}: the argument of {power} {error}") from None
    return f


def read_sides(
    field: str,
    field_data: Given | Sequence[Given] | Mapping[Any, Given],
    polygon: Polygon,
    ends: list[SideEnds],
    free: Collection[int],
    clamped: Collection[int],
    mesh: Mesh | None,
    where: str,
) -> list[SideData | Function]:
    """The data of the field g or q on every side, ZERO on sides that have none, (n sides,).

    On clamped sides g is ZERO here; the caller puts u_D there. One formula, function or array is for all
    sides that have data; the keys of a mapping are sides. The sides lie between the `ends`. Arrays have a
    value for each node of the `mesh`.

    Raises InputError, beginning with `where`.
    """
    n = len(ends)
    sides_with_data = {*free} if field == "q" else {*range(n)} - {*free, *clamped}
    if field == "g" and field_data is None and sides_with_data:
        first = polygon.label_side(min(sides_with_data))
        raise InputError(
            f"{where}: it is missing, and side {first} is neither free nor clamped; write one formula for "
            "all sides, or a list with one per side"
        )
    if isinstance(field_data, Mapping):
        if "table" in field_data:
            raise InputError(f"{where}: {TABLE_SIDE_NEEDED}")
        by_side = arguments.expand_sides(field_data.items(), polygon, where)
        field_data = [by_side.get(side) for side in range(n)]
    if isinstance(field_data, Sequence) and not isinstance(field_data, str | bytes):
        places = [f"{where}[{side}]" for side in range(n)]
        data = _read_list(field, field_data, places, where)
        for side in range(n):
            kind = "clamped" if side in clamped else "used" if side in sides_with_data else "unused"
            _check_list_entry(field, field_data[side], polygon.label_side(side), kind, places[side])
    else:
        places = [where] * n
        data = [read_data(field, field_data, where)] * n
        # q = 0, also where it is left out, needs no free side
        if field == "q" and not free and not (isinstance(data[0], Expression) and data[0].rational == 0):
            raise InputError(f"{where}: no side is free; name the sides with a given flux in free_sides")
    fitted: list[SideData | Function] = [ZERO] * n
    for side in sorted(sides_with_data):
        fitted[side] = fit_to_side(field, data[side], side, ends[side], mesh, places[side])
    return fitted


def _read_list(field: str, entries: Sequence[object], places: list[str], where: str) -> list[ReadData]:
    """The data of each side, from a list with one entry per side; errors name the places of entries."""
    if len(entries) != len(places):
        fault = f"{len(entries)} formulas for {len(places)} sides"
        raise InputError(f"{where}: {fault}; give one for all, or one per side")
    return [read_data(field, entry, place) for entry, place in zip(entries, places, strict=True)]


def read_data(field: str, data: object, where: str) -> ReadData:
    """A formula, function, array or table that a user gives; only a formula is checked here.

    Raises InputError, beginning with `where`, for what is none of these.
    """
    if callable(data):
        check_arguments(data, where)
        return data
    data = arguments.as_file_number(data, where)
    if is_nodal_array(data):
        return data
    if field != "f" and is_table(data):
        return read_table(data, where)
    if data is None or isinstance(data, str | Number):
        return read_formula(data, where, field)
    raise InputError(
        f"{where}: it is {quote_input(repr(data))}; it has to be a formula, a function or an array of values "
        "at nodes" + ", or on a side a table" * (field != "f")
    )


def fit_to_side(
    field: str, data: ReadData, side: int, ends: SideEnds, mesh: Mesh | None, where: str
) -> SideData | Function:
    """The data of a field on a side between two `ends`: g and u are Lipschitz there, arrays become traces.

    Tables are put on the side.
    """
    if isinstance(data, TableRows):
        return make_table(data, side, hypot(*(as_float(b - a) for a, b in zip(*ends, strict=True))))
    if isinstance(data, Expression):
        return data if field == "q" else check_lipschitz(data, ends, side, where)
    return data if callable(data) else make_trace(mesh, data, side, where)


def _check_list_entry(field: str, entry: object, side: str, kind: str, where: str) -> None:
    """Raises InputError for an entry that its side cannot have, and where one is missing.

    The field is "used" or "unused" on the side, which may also be "clamped".
    """
    if entry is not None and kind == "clamped":
        raise InputError(f"{where}: side {side} is clamped; write null, or take it out of u")
    if entry is not None and field == "g" and kind == "unused":
        raise InputError(f"{where}: side {side} is free; write null, or take it out of free_sides")
    if entry is not None and field == "q" and kind == "unused":
        raise InputError(f"{where}: side {side} is not free; write null, or name it in free_sides")
    if entry is None and field == "g" and kind == "used":
        raise InputError(
            f"{where}: there is no formula, and side {side} is neither free nor clamped; write one, or name "
            "the side in free_sides or in u"
        )


def check_lipschitz(formula: Expression, ends: SideEnds, side: int, where: str) -> Expression:
    """g or u on a side between two `ends`, a formula in x, y that is Lipschitz there, or InputError."""
    if not find_functions(formula, "pos"):
        return formula
    # The formula along the side, in which every kink has a place: s_+^k is Lipschitz for k >= 1
    (x0, y0), (x1, y1) = ends
    t = variable("t")
    on_side = {"x": x0 + t * (x1 - x0), "y": y0 + t * (y1 - y0)}
    along = substitute(formula, on_side, f"{where}, on side {side}")
    try:
        powers = [k for t, k in find_kinks(along, "t") if 0 <= t <= 1]
    except ValueError as error:
        raise InputError(f"{where}: {error}") from None
    if any(k < 1 for k in powers):
        raise InputError(
            f"{where}: on side {side} a power of pos is below 1; a Lipschitz function has 1 or more"
        )
    return formula


def exact_side_ends(exact_vertices: Sequence[list[Expression]]) -> list[SideEnds]:
    """The exact coordinates of the two ends of every side."""
    return [*zip(exact_vertices, [*exact_vertices[1:], exact_vertices[0]], strict=True)]


def exact_vertices(polygon: Polygon) -> list[list[Expression]]:
    """The coordinates of the vertices as exact decimals."""
    return [[exact(Fraction(repr(x))) for x in vertex] for vertex in polygon.vertices.tolist()]


def read_formula(text: object, where: str, field: str) -> Expression:
    """A formula in x, y without logarithms, 0 for None; see `data_checks.check_radicands` for its roots.

    Raises InputError for a word that says that there is no formula, too.
    """
    if isinstance(text, str) and text.strip().lower() in WORDS_FOR_NONE:
        raise InputError(f"{where}: '{text}' is no formula; {FIELD_SUBSTITUTES[field]}")
    least_power = KINK_POWER if field in "gu" else JUMP_POWER
    formula = parse_formula(0 if text is None else text, ("x", "y"), where, least_power)
    if has_log(formula):
        raise InputError(f"{where}: {NO_LOG}")
    return formula
