"""What pictures of a solution show: its title, how accurate it is, and values along the boundary."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from unilateral.arrays import Array, Index, Mask
from unilateral.discrete.choice import bound_mb
from unilateral.formulas.decimals import guaranteed, interval, up
from unilateral.formulas.expression import ONE
from unilateral.geometry.mesh import Mesh
from unilateral.problems.fields import LINEAR_BETWEEN_NODES, linear_fields
from unilateral.solution.bounds import is_believed, relative, wants_sharp
from unilateral.solution.coarser import clustered
from unilateral.solution.contact import Contact
from unilateral.system.memory import available_mb

if TYPE_CHECKING:
    from unilateral.solution.solution import Solution

WHAT = {"h1": "u in H¹", "hm12": "λ in H^(−1/2)"}
IN_ENERGY = {"h1": "u in the energy norm", "hm12": "λ in the dual norm"}
"""What is bounded in the norm of an accuracy; the second one is for problems with k, c or clamped sides."""
MOST = 200_000
"""A surface has at most about this many triangles: more are smaller than what is seen, and take long."""
CONSTANT = 1e-12
"""u_h that varies by less than this, relative to its size, is shown as a constant."""
APART = 0.07
"""The numbers of sides are at least this fraction of the perimeter apart."""
NO_BOUND = "no guaranteed bound on the error"


@dataclass(frozen=True, eq=False)
class Shown:
    """What is drawn of a solution, with values on the cells (m,) of the boundary.

    `title` says what problem it is, and `accuracy` what bound on the error is guaranteed. `u` (n,) belongs to
    the nodes of the mesh. `gap` (m,) has the means of u_h - g, without what the iteration left of 0, and
    `obstacle` (m,) those of g; both are NaN on `free` (m,) cells, which have no contact. `flux` (m,) is the
    q that is given there, 0 elsewhere. Some of the sides without contact are `clamped`.
    """

    title: str
    accuracy: str
    mesh: Mesh
    u: Array
    contact: Contact
    gap: Array
    obstacle: Array
    free: Mask
    flux: Array
    clamped: tuple[int, ...] = ()

    @cached_property
    def surface(self) -> tuple[Index, Index]:
        """Nodes (k,) and triangles (j, 3) between them that show u_h: those of the mesh, or not so many."""
        return clustered(self.mesh, MOST)

    @property
    def varies(self) -> bool:
        """Whether u_h is more than a constant up to rounding."""
        return float(np.ptp(self.u)) > CONSTANT * float(np.abs(self.u).max())

    @property
    def limits(self) -> tuple[float, float]:
        """The values that colours span: those of u_h, or more about a constant."""
        least = float(self.u.min())
        largest = float(self.u.max())
        room = 0.0 if self.varies else (max(-least, largest) or 1.0)
        return least - room, largest + room

    @property
    def where(self) -> str:
        """Where the contact is, in words."""
        if self.contact.full:
            return "contact everywhere, in red"
        if not self.contact.intervals:
            return "no contact"
        return f"contact in red, length {self.contact.length:.4g}"

    @property
    def no_gap(self) -> str:
        """What is said where u_h = g on all sides that are not free; else nothing."""
        held = ~self.free
        if np.nan_to_num(self.gap).any():
            return ""
        if not held.any():
            return "no side has an obstacle"
        some = "on all sides with an obstacle" if self.clamped else "on all sides that are not free"
        where = "everywhere" if held.all() else some
        return f"{'in contact' if (self.contact.lambda_H[held] > 0).all() else 'u = g'} {where}"


def numbered(of: Shown) -> list[int]:
    """The sides that are numbered: as many as there is room for along the boundary."""
    polygon = of.mesh.polygon
    last = -1.0
    found = list[int]()
    for side, middle in enumerate((polygon.starts[:-1] + polygon.lengths / 2) / polygon.perimeter):
        if middle - last >= APART:
            last = middle
            found.append(side)
    return found


def shown(solution: Solution) -> Shown:
    """What is drawn of a solution; the guaranteed bound is computed if the memory allows it."""
    gap = solution.gap
    free = np.isnan(gap)
    return Shown(
        title=solution.problem.title or solution.problem.name,
        accuracy=accuracy(solution),
        mesh=solution.mesh,
        u=solution.u,
        contact=solution.contact,
        gap=settled(gap, solution.multiplier) if solution.converged else gap,
        obstacle=np.where(free, np.nan, solution.solved.g_means),
        free=free,
        flux=np.where(free, _flux(solution), 0.0),
        clamped=solution.problem.clamped_sides,
    )


def _flux(solution: Solution) -> Array:
    """(m,) q in the middle of the cells."""
    cells = solution.partition
    q = solution.problem.enclosed_flux
    s = 0.5 * (cells.points[1:] + cells.points[:-1])
    return q.at(q.on(s), s)[0]


def accuracy(solution: Solution) -> str:
    """The guaranteed bound on the error in words, relative where it can be.

    It is that of the accuracy that was asked for, or else the cheap one on u.
    """
    search = solution.search
    goal = search.best.goal if search else None
    norm, sharp = (goal.norm, goal.sharp) if goal else ("h1", False)
    if search is None and bound_mb(solution.mesh, sharp) > available_mb():
        return ""
    bounded = solution.bounded
    total = bounded.total(norm, sharp)
    if not math.isfinite(total) or not is_believed(solution):
        return NO_BOUND
    problem = solution.problem
    in_H1 = problem.k == problem.c == ONE and not problem.clamped_sides
    what = (WHAT if in_H1 else IN_ENERGY)[norm]
    text = f"error of {what}: at most {_share(total, bounded.size(norm, sharp))}"
    text = guaranteed(text, -math.inf, total)
    if linear := linear_fields(solution.problem):
        text += f"; {', '.join(linear)} {LINEAR_BETWEEN_NODES}"
    if goal is None or solution.certified:
        return text
    wanted = f"{goal.accuracy:g}" if goal.absolute else f"{100 * goal.accuracy:.3g} %"
    return f"{text}; {wanted} was asked for"


def force(solution: Solution, of: Shown) -> str:
    """The force over the boundary in words, between guaranteed numbers where there is a bound."""
    if of.accuracy in ("", NO_BOUND) or of.free.all():
        return ""
    whole = solution.force(wants_sharp(solution))
    text = interval(whole.lower, whole.upper, whole.value, ".4g")
    return guaranteed(f"force over the boundary, ∫λ: {text}", whole.lower, whole.upper)


def _share(bound: float, size: float) -> str:
    """A bound as a percentage of a lower bound of the norm, or as it is where that would be 100 % or more."""
    share = relative(bound, size)
    return f"{up(math.nextafter(100 * share, math.inf), '.2g')} %" if share < 1 else up(bound, ".2g")


def settled(gap: Array, lambda_H: Array) -> Array:
    """u_h - g (m,), but 0 where it is no larger than what a converged iteration has left of 0; NaN stays.

    In exact arithmetic it is 0 where lambda_H > 0, and nowhere below 0. Values that differ from this tell the
    size of what is left.
    """
    held = np.isfinite(gap)
    rest = np.where(lambda_H[held] > 0, np.abs(gap[held]), np.maximum(-gap[held], 0.0))
    return np.where(np.abs(gap) <= rest.max(initial=0.0), 0.0, gap)
