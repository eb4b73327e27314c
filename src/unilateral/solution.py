"""A solution as users hold it: arrays, errors or bounds, files and a picture."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from unilateral import discrete_solution
from unilateral.accuracy.search import Search
from unilateral.arrays import Array
from unilateral.bounds.forces import Force, forces
from unilateral.errors import InputError
from unilateral.files import replacing
from unilateral.geometry import mesh as meshes
from unilateral.geometry import partition as partitions
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.mesh_files import write
from unilateral.geometry.partition import Partition
from unilateral.geometry.polygon import Polygon
from unilateral.norms.dual import Errors, errors
from unilateral.problems.case import Case
from unilateral.problems.units import Units

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr
    from matplotlib.figure import Figure


class Bounds(NamedTuple):
    """Guaranteed: ||u - u_h||_1 <= u and ||lambda - lambda_H||_{-1/2} <= multiplier.

    With coefficients ||v||_1 is the energy norm (k |v|_1^2 + c ||v||_0^2)^{1/2}, the other norm its dual.
    `unknown` is the part of both that comes from how well f and g could be enclosed.
    """

    u: float
    multiplier: float
    unknown: float


class Forces(NamedTuple):
    """Over the whole boundary, and over each of its sides."""

    whole: Force
    sides: list[Force]


@dataclass(frozen=True, eq=False)
class Solution:
    """(u_h, lambda_H) of one problem; `search` holds the levels where an accuracy was asked for.

    What was `solved` is the problem on its scaled domain; all that is shown here is in the user's `units`, on
    the user's `polygon`.
    """

    solved: discrete_solution.Solution
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

    @property
    def iterations(self) -> float:
        """Steps of the algorithm, on all levels; NaN if it counts none."""
        levels = [level.solved for level in self.search.done] if self.search else [self.solved]
        return sum(level.result.iterations for level in levels)

    @property
    def converged(self) -> bool:
        return bool(self.solved.result.converged)

    @property
    def certified(self) -> bool:
        """Whether an accuracy was asked for and is guaranteed."""
        return self.search is not None and self.search.certified

    @cached_property
    def errors(self) -> Errors | None:
        """The true errors of a case's solution."""
        return self.true_errors()

    def true_errors(self, dual: bool = True) -> Errors | None:
        """The same; without `dual` that in H^{-1/2} is NaN, which on large meshes costs more than a solve."""
        case, lambda_H = self.solved.discrete.data, self.multiplier
        if not isinstance(case, Case):
            return None
        return errors(case, self.mesh, self.u, self.partition, lambda_H, self.solved.discrete.unique, dual)

    @cached_property
    def bounds(self) -> Bounds | None:
        """The guaranteed bounds of the errors, where f and g are formulas.

        None, too, where those of all levels contradict each other, which would be a fault of this program.
        """
        return self._bounds(sharp=False)

    @cached_property
    def sharp_bounds(self) -> Bounds | None:
        """The same, mostly nearer to the errors, above all to that of lambda; slow on large meshes."""
        return self._bounds(sharp=True)

    def _bounds(self, sharp: bool) -> Bounds | None:
        bound = self.solved.bound(sharp) if self.search is None or self.search.believed else None
        return Bounds(bound.u, bound.lambda_, bound.unknown) if bound else None

    def forces(self, sharp: bool = False) -> Forces:
        """The integrals of lambda_H over the boundary and over each side, and guaranteed bounds of lambda's.

        They rest on `bounds` or the `sharp_bounds`; without these no upper bound is finite.
        """
        bounds, sides = self._bounds(sharp), range(self.mesh.polygon.n_sides)
        error = bounds.multiplier if bounds else math.inf
        parts = [[*sides], *([side] for side in sides)]
        free = self.solved.discrete.data.free_sides if self.solved.discrete.data else ()
        of = self.solved
        found = forces(of.discrete.mesh, of.discrete.partition, of.lambda_H, error, parts, free)
        whole, *each = (Force(*(self.units.force * number for number in force)) for force in found)
        return Forces(whole, each)

    def cells(self) -> pd.DataFrame:
        """A row per cell: its side, arc lengths and places of its ends, lambda_H, the mean of u_h - g."""
        import pandas as pd

        s, (start, end) = self.partition.points, self.partition.ends
        return pd.DataFrame(
            {
                "side": self.partition.side,
                "start": s[:-1],
                "end": s[1:],
                **dict(zip(("x_start", "y_start"), start.T, strict=True)),
                **dict(zip(("x_end", "y_end"), end.T, strict=True)),
                "multiplier": self.multiplier,
                "gap": self.gap,
            }
        )

    def dataset(self) -> xr.Dataset:
        """u_h on its mesh, and the columns of `cells`."""
        import xarray as xr

        return xr.Dataset(
            {
                "u": ("node", self.u, {"long_name": "u_h"}),
                "x": ("node", self.mesh.points[:, 0]),
                "y": ("node", self.mesh.points[:, 1]),
                "triangles": (("triangle", "corner"), self.mesh.triangles),
                **{name: ("cell", column.to_numpy()) for name, column in self.cells().items()},
            },
            attrs={"h": self.mesh.h, "H": self.partition.H, "algebraic_bound": self.solved.result.bound},
        )

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes a file: .vtu with u_h on its mesh, .csv with the cells of the boundary, .nc with both.

        In .vtu the boundary edges carry the mean of lambda_H on each. Raises InputError for another ending.
        """
        ending = Path(path).suffix
        if ending == ".vtu":
            on_edges = self.partition.means(self.multiplier, self.mesh.s)
            write(self.mesh, path, {"multiplier": on_edges}, {"u": self.u})
        elif ending == ".csv":
            with replacing(path) as temporary:
                self.cells().to_csv(temporary, index=False)
        elif ending == ".nc":
            with replacing(path) as temporary:
                self.dataset().to_netcdf(temporary)
        else:
            raise InputError(f"{path}: the ending must be .vtu, .nc or .csv")

    def plot(self) -> Figure:
        """u_h on its mesh, and along the boundary lambda_H and the gap u_h - g."""
        from unilateral.plot import figure

        return figure(self.mesh, self.u, self.partition, self.multiplier, self.gap)
