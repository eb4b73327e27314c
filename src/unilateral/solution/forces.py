"""The forces on sides, and the reactions on clamped ones, with guaranteed bounds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import TYPE_CHECKING, NamedTuple

from unilateral.bounds.forces import Force
from unilateral.errors import InputError
from unilateral.formulas.decimals import add_guarantee, format_interval, has_bound
from unilateral.formulas.expression import ZERO
from unilateral.problems import arguments
from unilateral.solution.bounds import bound_errors, uses_sharp_bounds

if TYPE_CHECKING:
    from unilateral.geometry.polygon import Polygon
    from unilateral.solution.solution import Solution

MAX_PRINTED_SIDES = 12


class Forces(NamedTuple):
    """The forces over all sides with contact, and over each side: 0 where there is none.

    `reactions` are those on clamped sides, by the numbers of the sides that are in a row. If c = 0, the sum
    of all forces and reactions is known, for it is - int f - int q; else `total` is None.
    """

    whole: Force
    sides: list[Force]
    reactions: Mapping[tuple[int, ...], Force] = MappingProxyType({})
    total: Force | None = None

    def __repr__(self) -> str:
        """One "guaranteed" at the end if all have bounds, else one for each that has."""
        clamped = {side for row in self.reactions for side in row}
        unclamped = {side: force for side, force in enumerate(self.sides) if side not in clamped}
        forces = [self.whole, *unclamped.values(), *self.reactions.values()]
        forces += [self.total] if self.total else []
        for_all = all(has_bound(force.lower, force.upper) for force in forces)
        sides = [f"{side}: {_format_force(force, not for_all)}" for side, force in unclamped.items()]
        omitted = f" and {len(sides) - MAX_PRINTED_SIDES} more" if len(sides) > MAX_PRINTED_SIDES else ""
        texts = [_format_force(self.whole, not for_all)]
        texts += [f"on sides {', '.join(sides[:MAX_PRINTED_SIDES])}{omitted}"] if sides else []
        for row, force in self.reactions.items():
            where = f"side{'s' * (len(row) > 1)} {' and '.join(map(str, row))}"
            texts.append(f"reaction on {where}: {_format_force(force, not for_all)}")
        if self.total:
            texts.append(f"sum of forces and reactions: {_format_force(self.total, not for_all)}")
        return f"Forces: {'; '.join(texts)}{'; guaranteed' if for_all else ''}"


def _format_force(force: Force, marks_guarantee: bool) -> str:
    """A force with its bounds as text, with the word "guaranteed" if it needs its own."""
    text = format_interval(force.lower, force.upper, force.value)
    return add_guarantee(text, force.lower, force.upper) if marks_guarantee else text


def group_adjacent_sides(n_sides: int, clamped: Sequence[int]) -> list[list[int]]:
    """The clamped ones of n sides, in rows of adjacent ones, over which reactions are summed.

    No function of V is 1 on one side of a row and 0 on the next, so only the sum over a row has bounds.
    """
    # a row begins where the side before is not clamped, or anywhere if all sides are
    starts = [side for side in clamped if (side - 1) % n_sides not in clamped] or [*clamped][:1]
    rows = []
    for start in starts:
        row = [start]
        while (row[-1] + 1) % n_sides in clamped and (row[-1] + 1) % n_sides != start:
            row.append((row[-1] + 1) % n_sides)
        rows.append(row)
    return rows


def compute_forces(solution: Solution, sharp: bool | None) -> Forces:
    """The forces over all sides with contact and over each side, and the reactions."""
    clamped = solution.problem.clamped_sides
    n = solution.polygon.n_sides
    rows = group_adjacent_sides(n, clamped)
    # over a clamped side alone nothing is known, so its group is empty; on free sides lambda is 0
    single_sides = [[side] if side not in clamped else [] for side in range(n)]
    with_contact = [side for side in range(n) if side not in clamped]
    contact_force, total, *group_forces = _bound_forces(
        solution, sharp, [with_contact, [*range(n)], *single_sides, *rows]
    )
    reactions = dict(zip(map(tuple, rows), group_forces[n:], strict=True))
    # (1.1) with v = 1: the sum of all is - int f - int q if c = 0, and not known without that
    return Forces(contact_force, group_forces[:n], reactions, total if solution.problem.c == ZERO else None)


def compute_force(solution: Solution, sharp: bool | None, sides: Sequence[int | str] | None) -> Force:
    """The force over some sides with their reactions, by default over all sides with contact.

    Raises InputError for a part of clamped sides in a row.
    """
    n = solution.polygon.n_sides
    clamped = solution.problem.clamped_sides
    if sides is None:
        return _bound_forces(solution, sharp, [[side for side in range(n) if side not in clamped]])[0]
    return _bound_forces(solution, sharp, [read_force_sides(sides, solution.polygon, clamped)])[0]


def read_force_sides(sides: Sequence[int | str], polygon: Polygon, clamped: Sequence[int]) -> list[int]:
    """The numbers of the sides of a force, which are given by numbers or names.

    Raises InputError for what is no list of sides, and for a part of clamped sides in a row.
    """
    side_numbers = arguments.as_side_numbers(sides, polygon, "sides")
    for row in group_adjacent_sides(polygon.n_sides, clamped):
        if 0 < len({*row} & {*side_numbers}) < len(row):
            raise InputError(
                f"sides {side_numbers}: the clamped sides {row} are in a row; take all or none of them"
            )
    return side_numbers


def _bound_forces(solution: Solution, sharp: bool | None, side_groups: list[list[int]]) -> list[Force]:
    """The forces, with reactions, over groups of sides, between bounds by Proposition S16.

    If nothing is said of `sharp`, the bounds are those by which an accuracy was asked for.
    """
    sharp = uses_sharp_bounds(solution) if sharp is None else sharp
    arguments.check_flags(sharp=sharp)
    bounds = bound_errors(solution, sharp)
    solved = solution.bounded if bounds else replace(solution.solved, data=None)
    return solved.bound_forces(side_groups, sharp, solution.problem.idle_sides())
