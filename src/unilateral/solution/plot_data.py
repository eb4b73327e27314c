"""What pictures of a solution show: its title, how accurate it is, and values along the boundary."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from unilateral.adaptive.goal import ERROR_NORMS
from unilateral.arrays import Array, Index, Mask
from unilateral.discrete.choice import bound_memory_mb
from unilateral.formulas.decimals import add_guarantee, format_interval, format_up
from unilateral.formulas.expression import ONE
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.polygon import Polygon
from unilateral.problems.fields import NODAL_VALUES_TEXT, linear_fields
from unilateral.solution.bounds import has_consistent_bounds, relative_bound
from unilateral.solution.contact import Contact
from unilateral.solution.node_clusters import cluster_nodes
from unilateral.system.memory import available_mb

if TYPE_CHECKING:
    from unilateral.solution.solution import Solution

H1_QUANTITIES = {"h1": "u in H¹", "hm12": "λ in H^(−1/2)"}
ENERGY_QUANTITIES = {"h1": "u in the energy norm", "hm12": "λ in the dual norm"}
"""Quantity whose error is bounded, by the norm of the accuracy; the latter with k, c or clamped sides."""
MAX_SURFACE_TRIANGLES = 200_000
"""A surface has at most about this many triangles: smaller ones cannot be seen, and take long."""
MAX_CONSTANT_VARIATION = 1e-12
"""u_h that varies by less than this, relative to its size, is shown as a constant."""
MIN_NUMBER_DISTANCE = 0.07
"""The numbers of sides are at least this fraction of the perimeter apart."""
NO_BOUND = "no guaranteed bound on the error"


@dataclass(frozen=True, eq=False)
class PlotData:
    """What is drawn of a solution, with values on the cells (m,) of the boundary.

    `title` says what problem it is, and `accuracy_text` what bound on the error is guaranteed. `u` (n,)
    belongs to the nodes of the mesh. `gap` (m,) has the means of u_h - g, without what the iteration left of
    0, and `obstacle` (m,) those of g; both are NaN on `no_contact` (m,) cells, which have no contact.
    `given_flux` (m,) is the q that is given there, 0 elsewhere. Some of the sides without contact are
    `clamped_sides`.
    """

    title: str
    accuracy_text: str
    mesh: Mesh
    u: Array
    contact: Contact
    gap: Array
    obstacle: Array
    no_contact: Mask
    given_flux: Array
    clamped_sides: tuple[int, ...] = ()

    @cached_property
    def surface(self) -> tuple[Index, Index]:
        """Nodes (k,) and triangles (j, 3) between them that show u_h: those of the mesh, or not so many."""
        return cluster_nodes(self.mesh, MAX_SURFACE_TRIANGLES)

    @property
    def has_variation(self) -> bool:
        """Whether u_h is more than a constant up to rounding."""
        return float(np.ptp(self.u)) > MAX_CONSTANT_VARIATION * float(np.abs(self.u).max())

    @property
    def colour_limits(self) -> tuple[float, float]:
        """The values that colours span: those of u_h, or more about a constant."""
        u_min = float(self.u.min())
        u_max = float(self.u.max())
        margin = 0.0 if self.has_variation else (max(-u_min, u_max) or 1.0)
        return u_min - margin, u_max + margin

    @property
    def contact_text(self) -> str:
        """Where the computed contact is, in words."""
        if self.contact.full:
            return "computed contact in red, everywhere"
        if not self.contact.intervals:
            return "no contact"
        return f"computed contact in red, length {self.contact.length:.4g}"

    @property
    def no_gap_text(self) -> str:
        """Words on where u_h = g if that holds on all sides with contact; empty if it does not."""
        has_contact = ~self.no_contact
        if np.nan_to_num(self.gap).any():
            return ""
        if not has_contact.any():
            return "no side has an obstacle"
        some = "on all sides with an obstacle" if self.clamped_sides else "on all sides that are not free"
        where = "everywhere" if has_contact.all() else some
        return f"{'in contact' if (self.contact.lambda_H[has_contact] > 0).all() else 'u = g'} {where}"


def select_numbered_sides(polygon: Polygon) -> list[int]:
    """Sides that are numbered in pictures: as many as find a place along the boundary."""
    last_middle = -1.0
    sides = list[int]()
    for side, middle in enumerate((polygon.starts[:-1] + polygon.lengths / 2) / polygon.perimeter):
        if middle - last_middle >= MIN_NUMBER_DISTANCE:
            last_middle = middle
            sides.append(side)
    return sides


def collect_plot_data(solution: Solution) -> PlotData:
    """Data of the pictures of a solution; the guaranteed bound is computed if the memory allows it."""
    gap = solution.gap
    no_contact = np.isnan(gap)
    # the given flux q in the middle of each cell
    partition = solution.partition
    q = solution.problem.enclosed_flux
    middles = 0.5 * (partition.points[1:] + partition.points[:-1])
    midpoint_flux = q.evaluate(q.find_pieces(middles), middles)[0]
    return PlotData(
        title=solution.problem.title or solution.problem.name,
        accuracy_text=describe_accuracy(solution),
        mesh=solution.mesh,
        u=solution.u,
        contact=solution.contact,
        gap=round_gap_to_zero(gap, solution.multiplier) if solution.converged else gap,
        obstacle=np.where(no_contact, np.nan, solution.solved.g_means),
        no_contact=no_contact,
        given_flux=np.where(no_contact, midpoint_flux, 0.0),
        clamped_sides=solution.problem.clamped_sides,
    )


def describe_accuracy(solution: Solution) -> str:
    """The guaranteed bound on the error in words, relative where it can be.

    It is that of the accuracy that was asked for, or else the cheap one on u.
    """
    search = solution.search
    goal = search.best.goal if search else None
    sharp = goal.sharp if goal else False
    norm = goal.norm if goal and goal.norm in ERROR_NORMS else "h1"
    if search is None and bound_memory_mb(solution.mesh, sharp) > available_mb():
        return ""
    bounded = solution.bounded
    total = bounded.total_bound(norm, sharp)
    if not math.isfinite(total) or not has_consistent_bounds(solution):
        return NO_BOUND
    problem = solution.problem
    in_H1 = problem.k == problem.c == ONE and not problem.clamped_sides
    quantity = (H1_QUANTITIES if in_H1 else ENERGY_QUANTITIES)[norm]
    # relative to a lower bound on the norm, unless that would be 100 % or more
    share = relative_bound(total, bounded.norm_lower_bound(norm, sharp))
    bound_text = format_up(total, ".2g")
    if share < 1:
        bound_text = f"{format_up(math.nextafter(100 * share, math.inf), '.2g')} %"
    text = add_guarantee(f"error of {quantity}: at most {bound_text}", -math.inf, total)
    if linear := linear_fields(solution.problem):
        text += f"; {', '.join(linear)} {NODAL_VALUES_TEXT}"
    if goal is None or solution.certified:
        return text
    target = f"{goal.accuracy:g}" if goal.absolute else f"{100 * goal.accuracy:.3g} %"
    return f"{text}; {target} was asked for"


def describe_force(solution: Solution, plot_data: PlotData) -> str:
    """The force over the boundary in words, between guaranteed numbers where there is a bound."""
    if plot_data.accuracy_text in ("", NO_BOUND) or plot_data.no_contact.all():
        return ""
    force = solution.force()
    text = format_interval(force.lower, force.upper, force.value, ".4g")
    return add_guarantee(f"force over the boundary, ∫λ: {text}", force.lower, force.upper)


def round_gap_to_zero(gap: Array, lambda_H: Array) -> Array:
    """Means (m,) of u_h - g, with 0 where they are no larger than the iteration's error; NaN stays."""
    has_contact = np.isfinite(gap)
    # exactly, the means are 0 where lambda_H > 0, and nowhere below 0: what differs is that error
    residuals = np.where(
        lambda_H[has_contact] > 0, np.abs(gap[has_contact]), np.maximum(-gap[has_contact], 0.0)
    )
    return np.where(np.abs(gap) <= residuals.max(initial=0.0), 0.0, gap)
