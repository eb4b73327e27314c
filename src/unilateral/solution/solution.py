"""A solution as users hold it; other modules of this room say what can be made of it."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, overload

import numpy as np
from numpy.typing import ArrayLike

from unilateral.adaptive.loop import Search
from unilateral.arrays import Array
from unilateral.bounds.enclosed_data import enclose_data
from unilateral.bounds.forces import Force
from unilateral.discrete.solution import DiscreteSolution
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition
from unilateral.geometry.polygon import Polygon
from unilateral.norms.dual import Errors, true_errors
from unilateral.norms.fortin import beta_lower_bound
from unilateral.problems import arguments
from unilateral.solution import evaluation, files, summary, tables
from unilateral.solution.bounds import Bounds, bound_errors, compute_error_shares, uses_sharp_bounds
from unilateral.solution.contact import Contact, prove_contact
from unilateral.solution.forces import Forces, compute_force, compute_forces
from unilateral.solution.record import make_solution_record
from unilateral.system.optional import require

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from unilateral.problems.problem import Problem


@dataclass(frozen=True, eq=False)
class Solution:
    """The discrete solution (u_h, lambda_H) as plain data; it can be copied and pickled.

    Parameters
    ----------
    problem
        What was solved.
    solved
        The solution of the discrete problem: what the iteration found.
    search
        The levels, where an accuracy was asked for; else None.

    >>> import unilateral as ul
    >>> ul.solve("natural", h=1 / 16, H=1 / 8)
    Solution of 'natural': a natural square-root transition in the middle of a side
      force            16.00 ± 0.21, guaranteed
      contact          computed: 3.5 of 4
      error of u       at most 0.204, 4.3 % of ||u||_1, guaranteed
      error of lambda  at most 0.203, 1.3 % of ||lambda||_-1/2, guaranteed
      unknowns         289, and 32 multipliers
      polygon          4 sides
    """

    problem: Problem
    solved: DiscreteSolution
    search: Search | None = None

    def __repr__(self) -> str:
        """A few lines; what takes long is left out, see `summary`."""
        return summary.render_summary_text(self)

    def _repr_html_(self) -> str:
        """Summary of the solution as a table of HTML, with the picture."""
        return summary.render_summary_html(self)

    def __dir__(self) -> list[str]:
        """Names of attributes, without those that serve other modules."""
        return [name for name in object.__dir__(self) if name not in ("bounded", "true_errors")]

    @property
    def polygon(self) -> Polygon:
        """The domain, as the user gave it."""
        return self.problem.polygon

    @property
    def mesh(self) -> Mesh:
        """The mesh, with its `points` (n, 2) and `triangles` (k, 3)."""
        return self.solved.mesh

    @property
    def partition(self) -> Partition:
        """T_H: cell i runs from the arc length `points`[i] to `points`[i + 1]."""
        return self.solved.partition

    @property
    def u(self) -> Array:
        """Values (n,) of u_h at the nodes of the mesh."""
        return self.solved.u_h

    @cached_property
    def multiplier(self) -> Array:
        """Values (m,) of lambda_H, which approximates k du/dn, on the cells of the partition.

        It is 0 on free sides. It is NaN on clamped sides, on which there are no multipliers: their reactions
        are in `forces`.
        """
        clamped = np.isin(self.partition.side, self.problem.clamped_sides)
        return np.where(clamped, math.nan, self.solved.lambda_H)

    @property
    def gap(self) -> Array:
        """Means (m,) of u_h - g on the cells, NaN on free and on clamped sides."""
        return self.solved.gap

    @property
    def converged(self) -> bool:
        """Whether the algebraic bound is at most the tolerance of the algorithm."""
        return bool(self.solved.result.converged)

    @property
    def unique(self) -> bool:
        """Whether lambda_H is known to be the only one; if not, beta may be 0.

        After a search it is, because a search takes two edges or more in every cell.
        """
        return self.search is not None or self.solved.unique

    @cached_property
    def contact(self) -> Contact:
        """The cells with lambda_H > 0: their `intervals`, `lengths` on sides, `length`; `full` if all are.

        These are computed; what is guaranteed is in `certain`.
        """
        return Contact(self.partition, self.multiplier, partial(prove_contact, self))

    @cached_property
    def bounded(self) -> DiscreteSolution:
        """`solved` with its data enclosed, by which errors are bounded.

        A case is solved without that, which takes longer than to solve it.
        """
        solved = self.solved
        if solved.data is not None:
            return solved
        return replace(solved, data=enclose_data(self.problem, solved.mesh, solved.form))

    def u_at(self, points: ArrayLike) -> Array:
        """u_h at a point (2,) or at many (k, 2), as an array () or (k,); NaN outside the polygon.

        Raises InputError for another shape.

        >>> import unilateral as ul
        >>> s = ul.solve("natural", h=1 / 16, H=1 / 8)
        >>> bool(s.u_at(s.mesh.points[7]) == s.u[7]), s.u_at([(1 / 3, 0), (2, 2)]).shape
        (True, (2,))
        """
        return evaluation.evaluate_at_points(
            self.mesh, points, partial(evaluation.evaluate_u_h, self.mesh, self.u)
        )

    def grad_at(self, points: ArrayLike) -> Array:
        """grad u_h at a point (2,) or at many (k, 2), as an array (2,) or (k, 2); NaN outside the polygon.

        It jumps at edges. There, and at nodes, it is that on the triangle with the least number.
        Raises InputError for another shape.

        >>> import unilateral as ul
        >>> s = ul.solve("natural", h=1 / 16, H=1 / 8)
        >>> s.grad_at((0.3, 0.2)).shape, s.grad_at([(0.3, 0.2), (1, 1)]).shape
        ((2,), (2, 2))
        """
        return evaluation.evaluate_at_points(
            self.mesh, points, lambda triangles, _: evaluation.evaluate_gradient(self.mesh, self.u, triangles)
        )

    def flux_at(self, points: ArrayLike) -> Array:
        """The flux at a point (2,) or at many (k, 2), as an array (2,) or (k, 2); NaN outside.

        It approximates k grad u, as `k * s.grad_at(points)` does, but its normal component has no jumps. It
        is the flux that the `bounds` rest on. On each triangle it is linear. On edges it is taken as
        `grad_at`.

        On meshes that resolve the length (k/c)^(1/2) it is in equilibrium: its divergence has on every
        triangle the mean of c u_h - f, and on the boundary its normal component is lambda_H, or its linear
        part on edges on which lambda_H is not constant, and the q that is given on free sides, linear on
        edges. These are meshes with c |a| <= 45 k, for the area |a| of the triangles at each node, and
        c |e|^2 <= 15 k for each boundary edge e; for c = 0 all. On others it is nearer to the mean of
        k grad u_h on both sides of each edge.

        Raises InputError for another shape.

        >>> import unilateral as ul
        >>> s = ul.solve("natural", h=1 / 16, H=1 / 8)
        >>> bool(abs(s.flux_at((0.3, 0))[1] + s.lambda_at(0, 0.3)) < 1e-6)
        True
        """
        bounded = self.bounded
        assert bounded.flux is not None  # the data of a user's problem are known
        flux = partial(evaluation.evaluate_flux, bounded.mesh, bounded.u_h, bounded.flux)
        return evaluation.evaluate_at_points(self.mesh, points, flux)

    def lambda_at(self, side: int, t: ArrayLike) -> Array:
        """lambda_H at the arc lengths t from the start of a side, in the shape of t.

        It is NaN beyond the side, and on clamped sides, see `multiplier`. Where two cells meet it is that of
        the later one. Raises InputError for a side that is not there.

        >>> import unilateral as ul
        >>> s = ul.solve("natural", h=1 / 16, H=1 / 8)
        >>> s.lambda_at(1, [0.3, 1.1]).round(2)
        array([3.68,  nan])
        """
        return evaluation.evaluate_on_side(self.partition, self.multiplier, side, t)

    @property
    def iterations(self) -> float:
        """Steps of the algorithm, on all levels; NaN if it counts none."""
        solves = [level.solved for level in self.search.levels] if self.search else [self.solved]
        return sum(solved.result.iterations for solved in solves)

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
        solved = self.solved
        if not len(solved.cells):
            return math.nan
        return beta_lower_bound(solved.mesh, solved.partition, solved.form)

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
        exact = self.problem.exact
        if exact is None:
            return None
        judged = self.solved.unique and len(self.solved.cells) > 0
        lambda_H = np.nan_to_num(self.multiplier)
        return true_errors(exact, self.mesh, self.u, self.partition, lambda_H, judged, dual)

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
        return bound_errors(self, sharp=False)

    @property
    def error_shares(self) -> Array | None:
        """Shares (k,) of the triangles in the square of `bounds.u`; None without bounds.

        >>> import unilateral as ul
        >>> s = ul.solve("natural", h=1 / 16, H=1 / 8)
        >>> round(float(s.error_shares.sum()), 9)
        1.0
        """
        return compute_error_shares(self)

    @property
    def sharp_bounds(self) -> Bounds | None:
        """Guaranteed bounds that are mostly tighter, above all the one on lambda; slow on large meshes.

        >>> import unilateral as ul
        >>> s = ul.solve("natural", h=1 / 16, H=1 / 8)
        >>> s.sharp_bounds.multiplier < s.bounds.multiplier
        True
        """
        return bound_errors(self, sharp=True)

    def forces(self, sharp: bool | None = None) -> Forces:
        """The integrals of lambda_H over the boundary and over each side, with guaranteed bounds on lambda's.

        On clamped sides they are the reactions, the integrals of k du/dn; those of sides in a row are given
        for all of them together. The whole has the sides with contact only. All rest on `bounds` or the
        `sharp_bounds`, by default those of the accuracy; without them no upper bound is finite. One of the
        bounds is infinite, too, where a clamped side meets one with contact and u is not known to be above g
        there; the sum of both has bounds: see `force`. If c = 0, the `total` of all forces and reactions is
        known up to the enclosures of f and q.
        """
        return compute_forces(self, sharp)

    def force(self, sharp: bool | None = None, sides: Sequence[int | str] | None = None) -> Force:
        """The force over all sides with contact, see `forces`, or over some sides, with their reactions.

        Raises InputError for a part of clamped sides in a row.
        """
        return compute_force(self, sharp, sides)

    def cells(self) -> pd.DataFrame:
        """A row per cell: its side, arc lengths and places of its ends, lambda_H, the mean of u_h - g."""
        require("tables of cells need", "pandas")
        import pandas as pd

        return pd.DataFrame(tables.solution_cell_columns(self))

    def certificate(self) -> dict[str, Any]:
        """Record of the solution for programs, with the fields of docs/command-line.md.

        The bounds are the sharp ones if an accuracy was asked for by them. For a case the true errors are
        included, except the one in H^{-1/2}.
        """
        sharp = uses_sharp_bounds(self)
        return make_solution_record(self, bound_errors(self, sharp), self.true_errors(dual=False), sharp)

    def dataset(self) -> xr.Dataset:
        """u_h on its mesh, and the columns of `cells`, by the CF conventions."""
        return tables.make_dataset(self)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes a file, by its ending: .vtu has u_h on its mesh, .csv the cells of the boundary, .nc both.

        .json has the `certificate`; .svg, .png and .pdf the picture; .html a page on which u_h is turned and
        zoomed, in any browser and without a network. In .vtu the boundary edges carry the mean of lambda_H on
        each, NaN on clamped sides, and the triangles their `error_shares`, if there are bounds. Raises
        InputError for another ending.
        """
        files.save_solution(self, path)

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
        files.save_certificate(self, path)

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
        from unilateral.solution.plot import draw_on_axes, draw_solution
        from unilateral.solution.plot_data import collect_plot_data

        plot_data = collect_plot_data(self)
        return draw_solution(plot_data) if ax is None else draw_on_axes(ax, plot_data)
