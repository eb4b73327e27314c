"""f on the triangles of a mesh made by refinement, from polynomials on those that they came from.

f is enclosed on the triangles of the first mesh. Where that leaves too much of f, they are replaced by those
that came from them, down to the mesh itself.

On a triangle f is near a polynomial p, |f - p| <= remainder. This holds on all triangles that lie in it. In
p's variables (`source_pieces`) the corners of the smaller triangles are multiples of ANCESTOR_GRID_STEP, for
each halving of an edge halves the differences. In memory nodes are rounded midpoints: every halving rounds
them by half an EPS of their size. The remainder holds for coordinates that are rounded by up to
VERTEX_ROUNDING of their size, so p is used on triangles up to MAX_ANCESTOR_HALVINGS halvings finer. Where
more steps follow, other p's are sought early, while triangles are few.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import astuple, dataclass
from functools import cache
from typing import NamedTuple

import numpy as np

from unilateral.arrays import Array, Index, Int32, Mask, row_blocks
from unilateral.bounds.source_pieces import (
    SOURCE_DEGREE,
    coordinate_scale,
    enclose_triangles,
    polynomial_means,
)
from unilateral.fem.quadrature import symmetric_rule
from unilateral.formulas.taylor import EPS, monomial_basis
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.plane import signed_areas
from unilateral.geometry.refinement import RefinementStep
from unilateral.problems.problem import SourceFunction

MAX_ANCESTOR_HALVINGS = 6
"""p is used on triangles up to this many halvings finer than its own; 8 would use up VERTEX_ROUNDING."""
ANCESTOR_GRID_STEP = 2.0**-MAX_ANCESTOR_HALVINGS
PROJECTION_ROUNDING = 192
"""`project_polynomials` is off by at most this times EPS sum |c|, in f_h and the root mean square of p - f_h.

Points are off by 2 EPS in either variable, monomials have degree 4, and Horner's scheme takes 16 operations:
p is off by 16 EPS sum |c| in each point. The numbers that make f_h of p have absolute values of 2.5 in sum,
and as many terms as there are points, 16: f_h is off by 60. What is left of p is off by both, by its own two
operations and by a mean of 16 terms: by 85, which, with f_h, makes 145.

By `_coefficient_matrices` a monomial is off by 10, and so is an entry of the first matrix by 2.5 (10 + 8) =
45; sums of 15 products add 7.5 times 2.5: f_h is off by 64. An entry of the second one is off by 10, 45 and
its own five operations on numbers up to 3.5, by 64; the products add 7.5 times 3.5, the mean 8: 98 and, with
f_h, 162.
"""
MIN_RUN_LENGTH = 128
"""Runs of triangles that lie alike in those around them get matrices if they are this long on average."""
TARGET_REMAINDER_RATIO = 0.01
"""E may be this times ||p - mean p|| times `relative_mesh_size`: like other errors it falls with h."""
COARSE_TARGET_SHARE = 0.1
"""On coarser triangles only this fraction of the target is allowed, for there it costs next to nothing."""
MIN_TARGET_RATIO = 1e-13
"""E may always be this times ||p||: that is the rounding of p, the same on smaller pieces."""


class Polynomials(NamedTuple):
    """p on triangles by its c (m, k), and its `remainder` (k,).

    `frame` (6, k) is the map from places to p's variables. Take a place less the last two rows. Its products
    with the first two rows and with the next two are the variables in units of ANCESTOR_GRID_STEP.
    """

    c: Array
    remainder: Array
    frame: Array

    def select(self, numbers: Index) -> Polynomials:
        """The polynomials that are chosen (k,)."""
        return Polynomials(*(values[..., numbers] for values in self))


def concatenate_polynomials(sets: Sequence[Polynomials]) -> Polynomials:
    """The polynomials of several sets, one set after another."""
    return Polynomials(*(np.concatenate(fields, axis=-1) for fields in zip(*sets, strict=True)))


def enclose_ancestors(corners: Array, scale: float, f: SourceFunction) -> Polynomials:
    """p on triangles with those corners (k, 3, 2), of a mesh of that `coordinate_scale`."""
    sets = []
    for block in row_blocks(len(corners)):
        c, remainder, ordered = enclose_triangles(corners[block], scale, f)
        frame = _frame(*ordered.transpose(1, 2, 0))
        sets.append(Polynomials(c, remainder + PROJECTION_ROUNDING * EPS * np.abs(c).sum(axis=0), frame))
    return concatenate_polynomials(sets)


def _frame(a: Array, u: Array, v: Array) -> Array:
    """The `frame` (6, k) of triangles with the corners a, u, v (2, k), in the order for sigma."""
    # x = (u + v) / 2 + sigma_1 d + sigma_2 e, solved for sigma by Cramer's rule
    d = 0.5 * (u - a)
    e = 0.5 * (v - a)
    scale = 1 / (ANCESTOR_GRID_STEP * (d[0] * e[1] - d[1] * e[0]))
    return np.stack([e[1] * scale, -e[0] * scale, -d[1] * scale, d[0] * scale, *(0.5 * (u + v))])


def project_polynomials(
    corners: tuple[Array, Array], polynomials: Polynomials, numbers: Int32
) -> tuple[Array, Array]:
    """The L2 projection f_h of p at the corners of each triangle, and the mean of (p - f_h)^2 there.

    The triangles have the `corners`, x and y, (3, k) each, and `numbers` (k,) says which p is known on each.
    Where refinement was uniform, triangles in a row lie alike in those around them: one matrix serves a run.
    """
    # the corners in p's variables are exact multiples of the grid step, so that equal ones can be told
    places = np.concatenate(corner_variables(corners, polynomials.frame.take(numbers, axis=1)))
    c = polynomials.c.take(numbers, axis=1)
    change = np.flatnonzero((places[:, 1:] != places[:, :-1]).any(axis=0)) + 1
    if MIN_RUN_LENGTH * (len(change) + 1) > len(numbers):
        return _project_each(places, c)
    starts = [0, *change.tolist()]
    runs = itertools.starmap(slice, itertools.pairwise([*starts, len(numbers)]))
    matrices = _coefficient_matrices(places[:, starts])
    products = np.empty((matrices.shape[1], len(numbers)))
    for run, matrix in zip(runs, matrices, strict=True):
        np.matmul(matrix, c[:, run], out=products[:, run])
    rest = products[3:]
    return products[:3], np.einsum("qk,qk->k", rest, rest)


def _project_each(variables: Array, c: Array) -> tuple[Array, Array]:
    """f_h (3, k) and the means of (p - f_h)^2 (k,), from p at points; `variables` (6, k) are the corners'."""
    hats, weights = symmetric_rule(2 * SOURCE_DEGREE)  # values (q, 3) of the hats at the rule's points
    p = _evaluate_polynomials(c, hats @ variables[:3], hats @ variables[3:])
    f_h = _corner_projection_matrix() @ p
    p -= hats @ f_h
    return f_h, weights @ p**2


def _coefficient_matrices(variables: Array) -> Array:
    """Matrices (r, 3 + q, m) from p's coefficients to f_h and then to q numbers, for each of r triangles.

    The squares of these numbers add up to the mean of (p - f_h)^2. `variables` (6, r) are the corners'.
    """
    hats, weights = symmetric_rule(2 * SOURCE_DEGREE)
    x = hats @ variables[:3]
    y = hats @ variables[3:]
    powers = [(x**i, y**i) for i in range(SOURCE_DEGREE + 1)]
    monomials = np.stack(
        [powers[i][0] * powers[j][1] for i, j in monomial_basis(2, SOURCE_DEGREE).exponents]
    ).T
    to_f_h = _corner_projection_matrix() @ monomials
    return np.concatenate([to_f_h, np.sqrt(weights)[:, None] * (monomials - hats @ to_f_h)], axis=1)


def corner_variables(corners: tuple[Array, Array], frame: Array) -> tuple[Array, Array]:
    """The exact variables of p, (3, k) each, at the `corners` of triangles, x and y; `frame` is of p."""
    xx, xy, yx, yy, *middle = frame
    x = corners[0] - middle[0]
    y = corners[1] - middle[1]
    return ANCESTOR_GRID_STEP * np.rint(xx * x + xy * y), ANCESTOR_GRID_STEP * np.rint(yx * x + yy * y)


def _evaluate_polynomials(c: Array, x: Array, y: Array) -> Array:
    """The values of polynomials at points, by Horner's scheme in y with coefficients by that in x, (q, k)."""
    number = {(i, j): k for k, (i, j) in enumerate(monomial_basis(2, SOURCE_DEGREE).exponents.tolist())}
    p = np.zeros_like(x)
    for j in range(SOURCE_DEGREE, -1, -1):
        x_polynomial = np.zeros_like(x)
        for i in range(SOURCE_DEGREE - j, -1, -1):
            x_polynomial *= x
            x_polynomial += c[number[i, j]]
        p *= y
        p += x_polynomial
    return p


@cache
def _corner_projection_matrix() -> Array:
    """The matrix (3, q) from a function at the rule's points to its L2 projection f_h at the corners."""
    hats, weights = symmetric_rule(2 * SOURCE_DEGREE)
    # the inverse of the mass matrix (1 + delta_ij) / 12 takes moments M_i to 12 M_i - 3 sum M_j
    return np.asarray((weights[:, None] * (12 * hats - 3)).T)


class Ancestors(NamedTuple):
    """Polynomials; each triangle has one, with the number in `numbers` (m,), `halvings` (m,) above it."""

    polynomials: Polynomials
    numbers: Int32
    halvings: Int32


@dataclass(frozen=True)
class PieceSums:
    """Sums over pieces: of E^2 (E as in `source`), ||p||^2, the integral of p and the area; their number."""

    remainder_squares: float = 0.0
    p_squares: float = 0.0
    p_integral: float = 0.0
    area: float = 0.0
    count: int = 0

    def __add__(self, sums: PieceSums) -> PieceSums:
        return PieceSums(*(a + b for a, b in zip(astuple(self), astuple(sums), strict=True)))

    def target(self, relative_size: float, share: float = 1.0) -> float:
        """The largest sum of E^2 that is wanted on a mesh of that `relative_size`; a `share` multiplies E.

        The wanted E is a fraction of ||f - mean f||, of which only ||p - mean p|| - E is certain.
        """
        E = math.sqrt(self.remainder_squares)
        norm = math.sqrt(self.p_squares)
        # ||p - mean p||^2 = ||p||^2 - (int p)^2 / |Omega|
        spread = math.sqrt(max(self.p_squares - self.p_integral * (self.p_integral / self.area), 0.0)) - E
        wanted_E = share * TARGET_REMAINDER_RATIO * relative_size * spread
        return max(wanted_E, MIN_TARGET_RATIO * (norm - E), 0.0) ** 2


def relative_mesh_size(mesh: Mesh, length_scale: float) -> float:
    """h / `length_scale`, at most 1: how much less a part of f with mean 0 counts than one of any mean.

    Paired with a z of the energy norm 1, k = 1, a part r with mean 0 gives at most h |z|_1 ||r||, another one
    at most length_scale ||r||, `Form.length_scale`. h^2 is twice the mean area of triangles.
    """
    return min(math.sqrt(2 * float(mesh.areas.sum()) / len(mesh.areas)) / length_scale, 1.0)


def max_halvings_now(n_following: int) -> int:
    """How many halvings triangles may be below those of their p, on a mesh after which so many steps follow.

    New p's are sought on meshes after which a multiple of MAX_ANCESTOR_HALVINGS steps follows: from no mesh
    with fewer triangles would they last as long. On other meshes p's need to last to the next of these.
    """
    return -n_following % MAX_ANCESTOR_HALVINGS if n_following else MAX_ANCESTOR_HALVINGS


def sum_pieces(p_means: Array, area: Array, remainder_squares: Array) -> PieceSums:
    """The sums over pieces, from the `polynomial_means` (2, k) of p, the areas (k,) and E^2 (k,)."""
    integral, square = (p_means @ area).tolist()
    return PieceSums(float(remainder_squares.sum()), square, integral, float(area.sum()), len(area))


class AncestorSearch:
    """The search for p, from the triangles of the first mesh, or of one before, to those made from them.

    On the mesh in hand each triangle has the polynomial with the number in `numbers` (m,), found `halvings`
    (m,) halvings above it. `is_coarse` (m,) marks the triangles whose polynomial is not near enough, `is_new`
    (m,) those that are new or whose polynomial is. `sums` are over the triangles where p is near enough or,
    if `sums_cover_mesh`, over all of the mesh before.
    """

    def __init__(
        self,
        mesh: Mesh,
        f: SourceFunction,
        relative_size: float,
        first_mesh: Mesh,
        ancestors: Ancestors | None,
        sums: PieceSums,
    ) -> None:
        """Search from the `first_mesh` on, with the `ancestors` that were found there, if any, and sums."""
        self.mesh = mesh
        self.f = f
        self.relative_size = relative_size
        n_monomials = len(monomial_basis(2, SOURCE_DEGREE).degrees)
        self.polynomials = Polynomials(np.empty((n_monomials, 0)), np.empty(0), np.empty((6, 0)))
        self.sums = sums
        self.sums_cover_mesh = ancestors is not None
        steps = mesh.steps[len(first_mesh.steps) :]
        n = len(first_mesh.triangles)
        self.numbers, self.halvings = np.zeros((2, n), dtype=np.int32)
        self.is_coarse: Mask = np.ones(n, dtype=bool)
        self.is_new: Mask = np.ones(n, dtype=bool)
        is_searched = self.is_coarse
        if ancestors:
            self.polynomials = ancestors.polynomials
            self.numbers = ancestors.numbers.copy()
            self.halvings = ancestors.halvings.copy()
            self.is_new[:] = False
            self.is_coarse = self._exceeds_coarse_target(ancestors.polynomials.remainder[ancestors.numbers])
            # not those with a p of their own, nor those that stay whole: what is known on them is kept
            is_split = np.isin(np.arange(n), np.concatenate([self.numbers[:0], *(s.parent for s in steps)]))
            is_far_below = self.halvings > max_halvings_now(len(steps))
            is_searched = is_split & (is_far_below | (self.is_coarse & (self.halvings > 0)))
        self._enclose(first_mesh.triangles[is_searched], np.flatnonzero(is_searched))
        for i, step in enumerate(steps, start=1):
            self._search_after(step, n_following=len(steps) - i)

    @property
    def ancestors(self) -> Ancestors:
        """The polynomials that were found, and on which triangles of the mesh each holds."""
        return Ancestors(self.polynomials, self.numbers, self.halvings)

    def _search_after(self, step: RefinementStep, n_following: int) -> None:
        """Go on to the mesh after a step; search where the ancestor is not near enough, or too far above."""
        self.numbers = step.inherit(self.numbers)
        self.halvings = step.inherit(self.halvings)
        self.is_coarse = step.inherit(self.is_coarse)
        self.is_new = step.inherit(self.is_new)
        self.halvings[step.triangles] += 1
        self.is_new[step.triangles] = True
        is_far_below = self.halvings[step.triangles] > max_halvings_now(n_following)
        again = self.is_coarse[step.triangles] | is_far_below
        self._enclose(step.nodes[again], step.triangles[again])

    def _enclose(self, nodes: Index, triangles: Index) -> None:
        """Enclose f on triangles of the mesh or a coarser one, with `nodes` (k, 3) and numbers (k,)."""
        if not triangles.size:
            return
        enclosed = enclose_ancestors(self.mesh.points[nodes], coordinate_scale(self.mesh), self.f)
        self.numbers[triangles] = len(self.polynomials.remainder) + np.arange(len(triangles))
        self.polynomials = concatenate_polynomials([self.polynomials, enclosed])
        self.halvings[triangles] = 0
        self.is_new[triangles] = True
        area = signed_areas(self.mesh.points, nodes)
        sums = self._extend_sums(enclosed, area)  # of all of f that is known, for the target is part of ||f||
        self.is_coarse[triangles] = self._exceeds_coarse_target(enclosed.remainder, sums)
        fine = np.flatnonzero(~self.is_coarse[triangles])
        self.sums = self._extend_sums(enclosed.select(fine), area[fine])

    def _extend_sums(self, polynomials: Polynomials, area: Array) -> PieceSums:
        """The sums with those over triangles of these areas (k,) added, unless they contain these already."""
        if self.sums_cover_mesh:
            return self.sums
        return self.sums + sum_pieces(polynomial_means(polynomials.c), area, area * polynomials.remainder**2)

    def _exceeds_coarse_target(self, remainder: Array, sums: PieceSums | None = None) -> Mask:
        """Where a remainder (k,) would be too large if all triangles of the mesh had it, (k,)."""
        target = (sums or self.sums).target(self.relative_size, COARSE_TARGET_SHARE)
        return np.asarray(remainder**2 * float(self.mesh.areas.sum()) > 0.5 * target)

    def find_coarse_triangles(self) -> Mask:
        """The triangles of the mesh on which the remainder is too large for the target, (m,).

        Half of what is wanted is shared out among the triangles, one half of it by area, the other equally;
        pieces of triangles that are cut (`source`) share the rest. New triangles near enough go to the sums.
        """
        coarse = np.flatnonzero(self.is_coarse)
        area = self.mesh.areas
        remainder = self.polynomials.remainder[self.numbers[coarse]]
        candidates = coarse[self.is_new[coarse]]
        polynomials = self.polynomials.select(self.numbers[candidates])
        target = self._extend_sums(polynomials, area[candidates]).target(self.relative_size)
        share = 0.5 * (area[coarse] / float(area.sum()) + 1 / len(area))
        is_coarse = np.zeros(len(area), dtype=bool)
        is_coarse[coarse] = area[coarse] * remainder**2 > 0.5 * target * share
        fine = candidates[~is_coarse[candidates]]
        self.sums = self._extend_sums(self.polynomials.select(self.numbers[fine]), area[fine])
        return is_coarse
