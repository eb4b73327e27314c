"""A solution as users hold it: arrays, errors or bounds, files and a picture."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, overload

import numpy as np
from numpy.typing import ArrayLike

from unilateral.accuracy.search import Search
from unilateral.arrays import Array
from unilateral.bounds.forces import Force, forces
from unilateral.discrete.base import DiscreteSolution
from unilateral.errors import InputError
from unilateral.formulas.decimals import up
from unilateral.geometry import mesh as meshes
from unilateral.geometry import partition as partitions
from unilateral.geometry.files import write_mesh
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition
from unilateral.geometry.polygon import Polygon
from unilateral.norms.dual import Errors, errors
from unilateral.problems.data import is_case
from unilateral.problems.units import Units
from unilateral.solution import tables
from unilateral.solution.certificate import Bounds, record
from unilateral.solution.contact import Contact
from unilateral.solution.evaluation import at_points
from unilateral.system import as_json
from unilateral.system.files import check_target, replacing, write_netcdf
from unilateral.system.optional import require

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


ROUNDING = 4 * float(np.finfo(float).eps)
"""Rounding a number twice changes it by less than this, relative to the number."""


def in_units(force: Force, unit: float) -> Force:
    """A force in that unit, which is rounded once, as is each product with it; bounds stay bounds."""
    value, lower, upper = (unit * number for number in force)
    return Force(value, (1 - ROUNDING) * lower, (1 + ROUNDING) * upper)


class Forces(NamedTuple):
    """The forces over the whole boundary, and over each of its sides."""

    whole: Force
    sides: list[Force]


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


def not_converged(bound: float) -> str:
    """Says that an iteration did not converge, with the bound on its algebraic error."""
    return f"the iteration did not converge: the algebraic error is at most {up(bound, '.4e')}"


@dataclass(frozen=True, eq=False)
class Solution:
    """(u_h, lambda_H) of one problem; `search` holds the levels where an accuracy was asked for.

    What was `solved` is the problem on its scaled domain; all that is shown here is in the user's `units`, on
    the user's `polygon`.
    """

    solved: DiscreteSolution
    polygon: Polygon
    units: Units
    search: Search | None = None

    @cached_property
    def mesh(self) -> Mesh:
        """`points` (n, 2) and `triangles` (k, 3)."""
        return meshes.similar(self.solved.discrete.mesh, self.polygon)

    @cached_property
    def partition(self) -> Partition:
        """T_H: cell i runs from the arc length `points`[i] to `points`[i + 1]."""
        return partitions.similar(self.solved.discrete.partition, self.polygon)

    @property
    def u(self) -> Array:
        """(n,) u_h at the nodes of the mesh."""
        return self.units.value * self.solved.u_h

    @property
    def multiplier(self) -> Array:
        """(m,) lambda_H, which approximates k du/dn, on the cells of the partition; 0 on free sides."""
        return self.units.flux * self.solved.lambda_H

    @property
    def gap(self) -> Array:
        """(m,) the means of u_h - g on the cells; NaN on free sides."""
        return self.units.value * self.solved.gap

    @cached_property
    def contact(self) -> Contact:
        """The cells with lambda_H > 0: their `intervals`, `lengths` on sides, `length`; `full` if all are."""
        return Contact(self.partition, self.multiplier)

    def u_at(self, points: ArrayLike) -> Array:
        """(k,) u_h at the points (k, 2), NaN outside the polygon. Raises InputError for another shape."""
        places = np.asarray(points, dtype=float)
        if places.ndim != 2 or places.shape[1] != 2:
            raise InputError(f"points: their shape {places.shape} must be (k, 2), a row for each point")
        return at_points(self.mesh, self.u, places)

    def lambda_at(self, side: int, t: ArrayLike) -> Array:
        """lambda_H at the arc lengths t from the start of a side, in the shape of t; NaN beyond the side.

        Where two cells meet it is that of the later one. Raises InputError for a side that is not there.
        """
        cells, polygon, s = self.partition, self.mesh.polygon, np.asarray(t, dtype=np.float64)
        if not 0 <= side < polygon.n_sides:
            raise InputError(f"side {side}: the sides of '{polygon.name}' are 0 to {polygon.n_sides - 1}")
        of = np.flatnonzero(cells.side == side)
        starts = cells.points[of] - polygon.starts[side]
        on = (s >= 0) & (s <= polygon.lengths[side])
        at = np.searchsorted(starts, np.where(on, s, 0.0), side="right") - 1
        return np.where(on, self.multiplier[of[at]], math.nan)

    @property
    def iterations(self) -> float:
        """Steps of the algorithm, on all levels; NaN if it counts none."""
        levels = [level.solved for level in self.search.done] if self.search else [self.solved]
        return sum(level.result.iterations for level in levels)

    @property
    def converged(self) -> bool:
        """Whether the algebraic bound is at most the tolerance of the algorithm."""
        return bool(self.solved.result.converged)

    @property
    def unique(self) -> bool:
        """Whether lambda_H is known to be the only one; if not, beta may be 0.

        After a search it is, because a search takes two edges or more in every cell.
        """
        return bool(self.search) or self.solved.discrete.unique

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
        case, lambda_H = self.solved.discrete.data, self.multiplier
        if not is_case(case):
            return None
        return errors(case, self.mesh, self.u, self.partition, lambda_H, self.solved.discrete.unique, dual)

    @cached_property
    def bounds(self) -> Bounds | None:
        """The guaranteed bounds on the errors, where f, g and q are formulas.

        None, too, where the bounds of all levels contradict each other, which would be a fault of this
        program.
        """
        return self._bounds(sharp=False)

    @cached_property
    def sharp_bounds(self) -> Bounds | None:
        """Guaranteed bounds that are mostly tighter, above all the one on lambda; slow on large meshes."""
        return self._bounds(sharp=True)

    def _bounds(self, sharp: bool) -> Bounds | None:
        bound = self.solved.bound(sharp) if self.search is None or self.search.believed else None
        return Bounds(bound.u, bound.lambda_, bound.unknown) if bound else None

    def forces(self, sharp: bool = False) -> Forces:
        """The integrals of lambda_H over the boundary and over each side, with guaranteed bounds on lambda's.

        These rest on `bounds` or the `sharp_bounds`; without them no upper bound is finite.
        """
        bounds, sides = self._bounds(sharp), range(self.mesh.polygon.n_sides)
        error = bounds.multiplier if bounds else math.inf
        parts = [[*sides], *([side] for side in sides)]
        free = self.solved.discrete.data.free_sides if self.solved.discrete.data else ()
        of = self.solved
        found = forces(of.discrete.mesh, of.discrete.partition, of.lambda_H, error, parts, free)
        whole, *each = (in_units(force, self.units.force) for force in found)
        return Forces(whole, each)

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
        return self.record(self._bounds(sharp), self.true_errors(dual=False), sharp)

    def record(self, bounds: Bounds | None, errors: Errors | None, sharp: bool) -> dict[str, Any]:
        """The fields of `certificate` with these errors and bounds, the `sharp` ones or the cheap ones."""
        return record(self, bounds, errors, sharp)

    def dataset(self) -> xr.Dataset:
        """u_h on its mesh, and the columns of `cells`, by the CF conventions."""
        sizes = {"h": self.mesh.h, "H": self.partition.H, "algebraic_bound": self.solved.result.bound}
        return tables.dataset(self.mesh, self.u, self._columns(), sizes)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes a file, by its ending: .vtu has u_h on its mesh, .csv the cells of the boundary, .nc both.

        .json has the `certificate`; .svg, .png and .pdf the picture; .html a page on which u_h is turned and
        zoomed, in any browser and without a network. In .vtu the boundary edges carry the mean of lambda_H on
        each. Raises InputError for another ending.
        """
        check_target(path, ENDINGS)
        if Path(path).suffix == ".vtu":
            on_edges = self.partition.means(self.multiplier, self.mesh.s)
            write_mesh(self.mesh, path, {"multiplier": on_edges}, {"u": self.u})
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

                temporary.write_text(page(self), encoding="utf-8")
            else:
                from unilateral.solution.plot import draw

                draw(self.plot(), temporary)

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
