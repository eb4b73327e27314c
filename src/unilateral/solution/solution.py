"""A solution as users hold it: arrays, errors or bounds, files and a picture."""

from __future__ import annotations

import math
import os
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple, overload

import numpy as np
from numpy.typing import ArrayLike

from unilateral.adaptive.loop import Search
from unilateral.arrays import Array, Index, floats
from unilateral.bounds.clamped_ends import Clamps, none
from unilateral.bounds.forces import Force, forces
from unilateral.bounds.local_bounds import LocalBound
from unilateral.certificates import export
from unilateral.discrete.solution import DiscreteSolution
from unilateral.errors import InputError, SolutionWarning
from unilateral.formulas.decimals import guaranteed, interval, is_bounded, up
from unilateral.geometry import mesh as meshes
from unilateral.geometry import partition as partitions
from unilateral.geometry.files import write_mesh
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition
from unilateral.geometry.polygon import Polygon
from unilateral.norms.dual import Errors, errors
from unilateral.norms.fortin import beta_below
from unilateral.problems import arguments
from unilateral.solution import summary, tables
from unilateral.solution.certificate import Bounds, BoundsWithoutReaction, record, relative, too_large
from unilateral.solution.contact import Contact
from unilateral.solution.evaluation import flux, gradient, located, value
from unilateral.system import as_json
from unilateral.system.files import check_target, replacing, write_netcdf
from unilateral.system.optional import require

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from unilateral.problems.problem import Problem

ROUNDING = 4 * float(np.finfo(float).eps)
"""Rounding a number twice changes it by less than this, relative to the number."""


def in_units(force: Force, unit: float) -> Force:
    """A force in that unit, which is rounded once, as is each product with it; bounds stay bounds."""
    value, lower, upper = (unit * number for number in force)
    return Force(value, lower - ROUNDING * abs(lower), upper + ROUNDING * abs(upper))


FLAT = 10.0
"""The cheap bound is a good one on triangles that are at most this many times as long as high.

It is 1.9 times the error then if u varies across them only, and for flatter ones the factor grows in
proportion: the error is like their height, but the flux of `equilibrated` is off by their length.
"""
ENDED_BY_ROUNDING = ("active_set", "multigrid")
"""Algorithms that end where nothing falls any more, and not after `max_steps`."""
SHOWN = 12
"""At most this many sides are printed."""


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
        others = {side: force for side, force in enumerate(self.sides) if side not in clamped}
        every = [self.whole, *others.values(), *self.reactions.values()]
        every += [self.total] if self.total else []
        for_all = all(is_bounded(force.lower, force.upper) for force in every)
        sides = [f"{side}: {_written(force, not for_all)}" for side, force in others.items()]
        more = f" and {len(sides) - SHOWN} more" if len(sides) > SHOWN else ""
        parts = [_written(self.whole, not for_all)]
        parts += [f"on sides {', '.join(sides[:SHOWN])}{more}"] if sides else []
        for row, force in self.reactions.items():
            where = f"side{'s' * (len(row) > 1)} {' and '.join(map(str, row))}"
            parts.append(f"reaction on {where}: {_written(force, not for_all)}")
        if self.total:
            parts.append(f"sum of forces and reactions: {_written(self.total, not for_all)}")
        return f"Forces: {'; '.join(parts)}{'; guaranteed' if for_all else ''}"


def _written(force: Force, alone: bool) -> str:
    """A force with its bounds; if it stands `alone`, with the word "guaranteed" where it has one."""
    text = interval(force.lower, force.upper, force.value)
    return guaranteed(text, force.lower, force.upper) if alone else text


def clamped_rows(n: int, clamped: Sequence[int]) -> list[list[int]]:
    """The clamped ones of n sides, those in a row together."""
    starts = [side for side in clamped if (side - 1) % n not in clamped] or [*clamped][:1]
    rows = []
    for start in starts:
        row = [start]
        while (row[-1] + 1) % n in clamped and (row[-1] + 1) % n != start:
            row.append((row[-1] + 1) % n)
        rows.append(row)
    return rows


ENDINGS = {
    ".vtu": ["meshio"],
    ".csv": [],
    ".nc": ["netCDF4", "xarray"],
    ".json": [],
    ".svg": ["matplotlib"],
    ".png": ["matplotlib"],
    ".pdf": ["matplotlib"],
    ".html": ["plotly"],
}
"""The endings of the files that `Solution.save` writes, and the optional packages that each needs."""


def not_unique(mesh: Mesh, own: bool) -> str:
    """Says that lambda_H may not be unique, and how to mend that; a mesh of the user's `own` has no h."""
    shortest = float(mesh.polygon.lengths.min())
    advice, alone = "take h < H, such as H = 2h", np.bincount(mesh.side) == 1
    if own and alone.any():
        advice = (
            f"a side of the polygon needs two edges of the mesh or more, and side {alone.argmax()} is one; "
            "take ul.mesh(mesh, halvings=1)"
        )
    elif own:
        advice = "take larger cells, or refine the mesh at the boundary"
    elif mesh.h >= shortest:  # whatever h and H were asked for
        advice = f"a side of the length {shortest:.4g} is one edge; take h <= {shortest / 2:.4g} and H = 2h"
    return f"may not be unique, because beta is 0 up to rounding; {advice}"


def flat_triangles(solved: DiscreteSolution) -> str:
    """Says that flat triangles make up most of the cheap bound; else empty."""
    bound, mesh = solved.bound(False), solved.mesh
    if not isinstance(bound, LocalBound):
        return ""
    flatness = mesh.longest_edges**2 / (2 * mesh.areas)  # the longest edge over the height on it
    flat = flatness > FLAT
    if not bound.shares[flat].sum() > 0.5 * bound.shares.sum():
        return ""
    return (
        "most of the bound on the error comes from triangles that are up to "
        f"{flatness.max():.0f} times as long as high, where it may be far above the error; try --sharp, or "
        "other triangles"
    )


def lift_dominates(solved: DiscreteSolution) -> str:
    """Says of another program's u that most of its bound is what makes it admissible; else empty."""
    bound = solved.bound() if solved.foreign and not too_large(solved, False) else None
    if not isinstance(bound, LocalBound) or bound.lifting**2 <= 0.5 * bound.u**2:
        return ""
    return (
        "most of the bound on the error of u is for u < g, or for other values than the given ones on "
        "clamped sides; larger penalty parameters, or conditions at the nodes, would make it smaller"
    )


def not_converged(solved: DiscreteSolution) -> str:
    """Says that an iteration did not converge, with the bound on its algebraic error, and why."""
    result = solved.result
    bound = interval(-math.inf, result.bound, spec=".4e")
    told = f"the iteration did not converge: the algebraic error is {bound}"
    if 2 * result.rounding > result.bound:
        return f"{told}, because rounding alone adds {up(result.rounding, '.1e')}; take a larger tolerance"
    if result.algorithm in ENDED_BY_ROUNDING:
        return f"{told}, because rounding allows no less; take a larger tolerance"
    return f"{told} after {result.iterations:.6g} steps; allow more of them, or take another algorithm"


@dataclass(frozen=True, eq=False)
class Solution:
    """(u_h, lambda_H) of the `problem`; `search` holds the levels where an accuracy was asked for.

    What was `solved` is the problem on its scaled domain; all that is shown here is in the user's units, on
    the user's polygon. Solutions can be copied and pickled.

    >>> import unilateral as ul
    >>> ul.solve("natural", h=1 / 16, H=1 / 8)
    Solution of 'natural': a natural square-root transition in the middle of a side
      polygon          4 sides
      unknowns         289, and 32 multipliers
      error of u       at most 0.204, 4.3 % of ||u||_1, guaranteed
      error of lambda  at most 0.203, 1.3 % of ||lambda||_-1/2, guaranteed
      force            16.00 ± 0.21, guaranteed
      contact          length 3.5 of 4
    """

    solved: DiscreteSolution
    problem: Problem
    """What was solved."""
    search: Search | None = None

    def __repr__(self) -> str:
        """A few lines; what takes long is left out, see `summary`."""
        return summary.text(self)

    def _repr_html_(self) -> str:
        """The same as a table, with the picture."""
        return summary.html(self)

    @property
    def polygon(self) -> Polygon:
        """The domain, as the user gave it."""
        return self.problem.polygon

    @cached_property
    def mesh(self) -> Mesh:
        """`points` (n, 2) and `triangles` (k, 3)."""
        return meshes.similar(self.solved.mesh, self.polygon)

    @cached_property
    def partition(self) -> Partition:
        """T_H: cell i runs from the arc length `points`[i] to `points`[i + 1]."""
        return partitions.similar(self.solved.partition, self.polygon)

    @property
    def u(self) -> Array:
        """(n,) u_h at the nodes of the mesh."""
        return self.problem.units.value * self.solved.u_h

    @property
    def multiplier(self) -> Array:
        """(m,) lambda_H, which approximates k du/dn, on the cells of the partition; 0 on free sides.

        NaN on clamped sides, on which there are no multipliers: their reactions are in `forces`.
        """
        clamped = np.isin(self.partition.side, self.problem.clamped_sides)
        return np.where(clamped, math.nan, self.problem.units.flux * self.solved.lambda_H)

    @property
    def gap(self) -> Array:
        """(m,) the means of u_h - g on the cells; NaN on free sides."""
        return self.problem.units.value * self.solved.gap

    @cached_property
    def contact(self) -> Contact:
        """The cells with lambda_H > 0: their `intervals`, `lengths` on sides, `length`; `full` if all are."""
        return Contact(self.partition, self.multiplier)

    def u_at(self, points: ArrayLike) -> Array:
        """u_h at a point (2,) or at many (k, 2), as an array () or (k,); NaN outside the polygon.

        Raises InputError for another shape.

        >>> import unilateral as ul
        >>> s = ul.solve("natural", h=1 / 16, H=1 / 8)
        >>> bool(s.u_at(s.mesh.points[7]) == s.u[7]), s.u_at([(1 / 3, 0), (2, 2)]).shape
        (True, (2,))
        """
        return self._at(points, partial(value, self.mesh, self.u))

    def grad_at(self, points: ArrayLike) -> Array:
        """grad u_h at a point (2,) or at many (k, 2), as an array (2,) or (k, 2); NaN outside the polygon.

        It jumps at edges. There, and at nodes, it is that on the triangle with the least number.
        Raises InputError for another shape.

        >>> import unilateral as ul
        >>> s = ul.solve("natural", h=1 / 16, H=1 / 8)
        >>> s.grad_at((0.3, 0.2)).shape, s.grad_at([(0.3, 0.2), (1, 1)]).shape
        ((2,), (2, 2))
        """
        return self._at(points, lambda of, _: gradient(self.mesh, self.u, of))

    def flux_at(self, points: ArrayLike) -> Array:
        """The equilibrated flux at a point (2,) or at many (k, 2), as an array (2,) or (k, 2); NaN outside.

        It approximates k grad u, as `k * s.grad_at(points)` does, and more: its normal component has no jumps
        and is lambda_H on the boundary, or its linear part on edges on which lambda_H is not constant, and
        the q that is given on free sides, linear on edges. Its divergence has on every triangle the mean of
        c u_h - f. It is the flux that the `bounds` rest on: k^(-1/2) times the L2 norm of its error is at
        most `bounds.multiplier`. On each triangle it is linear. On edges it is taken as `grad_at`.

        Raises InputError for another shape.

        >>> import unilateral as ul
        >>> s = ul.solve("natural", h=1 / 16, H=1 / 8)
        >>> float(s.flux_at((0.3, 0))[1]) == -float(s.lambda_at(0, 0.3))
        True
        """
        q, of_v = self.solved.flux, self.solved.mesh
        assert q is not None  # the data of a user's problem are known
        return self.problem.units.flux * self._at(points, partial(flux, of_v, self.solved.u_h, q))

    def _at(self, points: ArrayLike, of: Callable[[Index, Array], Array]) -> Array:
        places = floats(points, "points")
        if places.ndim not in (1, 2) or places.shape[-1] != 2:
            raise InputError(
                f"points: their shape {places.shape} must be (2,), a point, or (k, 2), a row for each point"
            )
        found = located(self.mesh, places.reshape(-1, 2)).values(of)
        return found.reshape((*places.shape[:-1], *found.shape[1:]))

    def lambda_at(self, side: int, t: ArrayLike) -> Array:
        """lambda_H at the arc lengths t from the start of a side, in the shape of t.

        It is NaN beyond the side, and on clamped sides, see `multiplier`. Where two cells meet it is that of
        the later one. Raises InputError for a side that is not there.

        >>> import unilateral as ul
        >>> s = ul.solve("natural", h=1 / 16, H=1 / 8)
        >>> s.lambda_at(1, [0.3, 1.1]).round(2)
        array([3.68,  nan])
        """
        cells, polygon, s = self.partition, self.mesh.polygon, floats(t, "t")
        side = arguments.side(side, polygon.n_sides, "side")
        of = np.flatnonzero(cells.side == side)
        starts = cells.points[of] - polygon.starts[side]
        on = (s >= 0) & (s <= polygon.lengths[side])
        at = np.searchsorted(starts, np.where(on, s, 0.0), side="right") - 1
        return np.where(on, self.multiplier[of[at]], math.nan)

    @property
    def iterations(self) -> float:
        """Steps of the algorithm, on all levels; NaN if it counts none."""
        solves = [level.solved for level in self.search.levels] if self.search else [self.solved]
        return sum(solved.result.iterations for solved in solves)

    @property
    def converged(self) -> bool:
        """Whether the algebraic bound is at most the tolerance of the algorithm."""
        return bool(self.solved.result.converged)

    @property
    def unique(self) -> bool:
        """Whether lambda_H is known to be the only one; if not, beta may be 0.

        After a search it is, because a search takes two edges or more in every cell.
        """
        return bool(self.search) or self.solved.unique

    @cached_property
    def beta(self) -> float:
        """A guaranteed lower bound on the inf-sup constant of (3.4) in H^(-1/2), by Theorem 5's proof.

        The algebraic error of lambda_H in that norm is at most the algebraic bound over it. It is 0, which
        says nothing, where a cell has no node well inside, and NaN where no side carries contact. Its time is
        proportional to the unknowns: about twenty seconds per million.

        >>> import unilateral as ul
        >>> 0.4 < ul.solve("natural", h=1 / 16, H=1 / 8).beta < 0.74
        True
        """
        of = self.solved
        return beta_below(of.mesh, of.partition, of.form) if len(of.cells) else math.nan

    @property
    def _believed(self) -> bool:
        """Whether bounds are believed: only a fault of this program makes those of all levels contradict."""
        return self.search is None or bool(self.search.believed)

    @property
    def certified(self) -> bool:
        """Whether an accuracy was asked for and is guaranteed."""
        return self.search is not None and self.search.certified

    @cached_property
    def errors(self) -> Errors | None:
        """The true errors of a case's solution."""
        return self.true_errors()

    def true_errors(self, dual: bool = True) -> Errors | None:
        """The true errors of a case's solution.

        Without `dual` the one in H^{-1/2} is NaN, because on large meshes it costs more than a solve.
        """
        arguments.check_flags(dual=dual)
        of, exact = self.solved, self.problem.exact
        if exact is None:
            return None
        judged = of.unique and len(of.cells) > 0
        lambda_H = self.problem.units.flux * self.solved.lambda_H
        return errors(exact, self.mesh, self.u, self.partition, lambda_H, judged, dual)

    @property
    def bounds(self) -> Bounds | None:
        """The guaranteed bounds on the errors.

        None, with a SolutionWarning, where they take more memory than is free, and where the bounds of all
        levels contradict each other, which would be a fault of this program.

        >>> import unilateral as ul
        >>> s = ul.solve("natural", h=1 / 16, H=1 / 8)
        >>> s.errors.h1 <= s.bounds.u and 0 < s.bounds.relative_u < 0.1
        True
        """
        return self._bounds(sharp=False)

    @property
    def error_shares(self) -> Array | None:
        """(k,) each triangle's part of the squares in `bounds.u`; their sum is 1. None without bounds.

        >>> import unilateral as ul
        >>> s = ul.solve("natural", h=1 / 16, H=1 / 8)
        >>> round(float(s.error_shares.sum()), 9)
        1.0
        """
        shares = self.solved.shares if self.bounds else np.zeros(1)
        whole = float(shares.sum())
        return shares / whole if 0 < whole < math.inf else None

    @property
    def sharp_bounds(self) -> Bounds | None:
        """Guaranteed bounds that are mostly tighter, above all the one on lambda; slow on large meshes.

        >>> import unilateral as ul
        >>> s = ul.solve("natural", h=1 / 16, H=1 / 8)
        >>> s.sharp_bounds.multiplier < s.bounds.multiplier
        True
        """
        return self._bounds(sharp=True)

    def _bounds(self, sharp: bool) -> Bounds | None:
        refused = too_large(self.solved, sharp)
        if refused:
            warnings.warn(refused, SolutionWarning, stacklevel=3)
        bound = self.solved.bound(sharp) if self._believed and not refused else None
        if bound is None:
            return None
        of_u, of_lambda = (self.solved.size(norm, sharp) for norm in ("h1", "hm12"))
        parts = relative(bound.u, of_u), relative(bound.lambda_, of_lambda)
        kind = Bounds if self.problem.units.reaction else BoundsWithoutReaction
        of_multiplier = bound.lambda_ if len(self.solved.cells) else math.nan
        return kind(bound.u, of_multiplier, bound.unknown, *parts)

    def forces(self, sharp: bool = False) -> Forces:
        """The integrals of lambda_H over the boundary and over each side, with guaranteed bounds on lambda's.

        On clamped sides they are the reactions, the integrals of k du/dn; those of sides in a row are given
        for all of them together. The whole has the sides with contact only. All rest on `bounds` or the
        `sharp_bounds`; without them no upper bound is finite. One of the bounds is infinite, too, where a
        clamped side meets one with contact and u is not known to be above g there; the sum of both has
        bounds: see `force`. If c = 0, the `total` of all forces and reactions is known up to the enclosures
        of f and q.
        """
        clamped, n = self.problem.clamped_sides, self.polygon.n_sides
        rows = clamped_rows(n, clamped)
        with_contact = [[side] if side not in clamped else [] for side in range(n)]
        every = [side for side in range(n) if side not in clamped]
        whole, total, *each = self._forces(sharp, [every, [*range(n)], *with_contact, *rows])
        reactions = dict(zip(map(tuple, rows), each[n:], strict=True))
        return Forces(whole, each[:n], reactions, None if self.problem.units.reaction else total)

    def force(self, sharp: bool = False, sides: Sequence[int] | None = None) -> Force:
        """The force over all sides with contact, see `forces`, or over some sides, with their reactions.

        Raises InputError for a part of clamped sides in a row.
        """
        n, clamped = self.polygon.n_sides, self.problem.clamped_sides
        if sides is None:
            return self._forces(sharp, [[side for side in range(n) if side not in clamped]])[0]
        part = arguments.sides(sides, n, "sides")
        for row in clamped_rows(n, clamped):
            if 0 < len({*row} & {*part}) < len(row):
                raise InputError(
                    f"sides {part}: the clamped sides {row} are in a row; take all or none of them"
                )
        return self._forces(sharp, [part])[0]

    def _forces(self, sharp: bool, parts: list[list[int]]) -> list[Force]:
        arguments.check_flags(sharp=sharp)
        bounds, of = self._bounds(sharp), self.solved
        form, n, error = of.form, self.polygon.n_sides, bounds.multiplier if bounds else math.inf
        unknown = np.where(np.isin(np.arange(n), form.clamped), math.nan, np.zeros((2, n)))
        clamps = Clamps(form, unknown, none(n), math.inf)
        if form.clamped and bounds:
            known, local = of.bound(sharp), of.bound(False)
            if known and isinstance(local, LocalBound):
                clamps = Clamps(form, known.outflows, local.ends, known.of_fluxes, of.force_balance)
        found = forces(of.mesh, of.partition, of.lambda_H, error, parts, clamps)
        return [in_units(force, self.problem.units.force) for force in found]

    def cells(self) -> pd.DataFrame:
        """A row per cell: its side, arc lengths and places of its ends, lambda_H, the mean of u_h - g."""
        require("tables of cells need", "pandas")
        import pandas as pd

        return pd.DataFrame(self._columns())

    def _columns(self) -> tables.Columns:
        return tables.of_cells(self.partition, multiplier=self.multiplier, gap=self.gap)

    def certificate(self) -> dict[str, Any]:
        """What is known of the solution: the fields of docs/command-line.md.

        The bounds are the sharp ones if an accuracy was asked for by them. For a case the true errors are
        included, except the one in H^{-1/2}.
        """
        sharp = self.search is not None and self.search.best.goal.sharp
        return record(self, self._bounds(sharp), self.true_errors(dual=False), sharp)

    def dataset(self) -> xr.Dataset:
        """u_h on its mesh, and the columns of `cells`, by the CF conventions."""
        told = {"h": self.mesh.h, "H": self.partition.H, "algebraic_bound": self.solved.result.bound}
        bounds = self._bounds(sharp=False)
        told |= {"h1_bound": bounds.u, "hm12_bound": bounds.multiplier} if bounds else {}
        if self.solved.foreign:
            told.pop("algebraic_bound")
        return tables.dataset(self.mesh, self.u, self._columns(), told)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes a file, by its ending: .vtu has u_h on its mesh, .csv the cells of the boundary, .nc both.

        .json has the `certificate`; .svg, .png and .pdf the picture; .html a page on which u_h is turned and
        zoomed, in any browser and without a network. In .vtu the boundary edges carry the mean of lambda_H on
        each, NaN on clamped sides, and the triangles their `error_shares`, if there are bounds. Raises
        InputError for another ending.
        """
        check_target(path, ENDINGS)
        if Path(path).suffix == ".vtu":
            on_edges = self.partition.means(self.problem.units.flux * self.solved.lambda_H, self.mesh.s)
            on_edges[np.isin(self.mesh.side, self.problem.clamped_sides)] = math.nan
            shares = self.error_shares
            on_triangles = {} if shares is None else {"error_share": shares}
            write_mesh(self.mesh, path, {"multiplier": on_edges}, {"u": self.u}, on_triangles)
            return
        if Path(path).suffix == ".json":
            as_json.write(self.certificate(), path)
            return
        with replacing(path) as temporary:
            if temporary.suffix == ".csv":
                tables.write_csv(self._columns(), temporary)
            elif temporary.suffix == ".nc":
                write_netcdf(self.dataset(), temporary)
            elif temporary.suffix == ".html":
                from unilateral.solution.interactive import page

                temporary.write_text(page(self), encoding="utf-8", newline="\n")
            else:
                from unilateral.solution.plot import draw

                draw(self.plot(), temporary)

    def save_certificate(self, path: str | os.PathLike[str]) -> None:
        """Writes a file from which `certificate/check.py` proves the cheap bound, without this package.

        If f, g or q is a formula that it does not read, `certificate/check_formulas.py` does.

        Parameters
        ----------
        path : str or path
            A name that ends in .json or .json.gz.

        Raises
        ------
        InputError
            For another ending, and for what no checker reads: functions, arrays, cases, pos, irrational k
            and c, and u that is not quadratic along its side.
        """
        check_target(path, export.CERTIFICATE_ENDINGS)
        judged = export.judge_solution(self.solved, self.mesh, self.problem.units)
        export.write_certificate(export.make_certificate(self.problem, judged), path)

    @overload
    def plot(self) -> Figure: ...

    @overload
    def plot(self, ax: Axes) -> Axes: ...

    def plot(self, ax: Axes | None = None) -> Figure | Axes:
        """u_h with the contact set, lambda_H and the gap along the boundary; the mesh if it is adapted.

        On the axes `ax` of a figure of your own only the first of these is drawn, and `ax` is returned.
        Raises InputError if they are no plane axes of matplotlib.
        """
        require("pictures need", "matplotlib")
        from unilateral.solution.plot import figure, on_axes
        from unilateral.solution.shown import shown

        return figure(shown(self)) if ax is None else on_axes(ax, shown(self))
