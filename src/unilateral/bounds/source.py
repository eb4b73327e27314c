"""f enclosed on a mesh: its linear part on every triangle, and a bound on what the rest can do.

On a piece f is near a polynomial p, |f - p| <= remainder (`taylor`). On a mesh made by refinement the first
pieces are the triangles of the first mesh; where the remainder is not small they are replaced by those that
came from them (`source_ancestors`). Triangles of the mesh itself are cut at a jump, where the bound holds but
for a part whose area is bounded (`source_pieces`). Pieces are quartered until sum |piece| remainder^2 is
small, so that no peak of f can hide between points. With f_h the L2 projection of p to linear functions on
each triangle T, p - f_h is orthogonal to linear functions there, and E_T >= ||f - p||_T. `residual_norm`
has what both can do.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from unilateral.arrays import Array, Index, Mask, as_slice, row_blocks
from unilateral.bounds.source_ancestors import (
    Ancestors,
    AncestorSearch,
    PieceSums,
    project_polynomials,
    relative_mesh_size,
    sum_pieces,
)
from unilateral.bounds.source_pieces import (
    TrianglePieces,
    attainable_squares,
    coordinate_scale,
    enclose_pieces,
    hat_means,
    polynomial_means,
    widen_areas,
)
from unilateral.fem.form import Form
from unilateral.fem.p1 import add_moments, linear_moments
from unilateral.fem.p2 import linear_square_norms
from unilateral.fem.splitting import quarter
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.plane import corner_coordinates
from unilateral.problems.problem import SourceFunction

MIN_QUARTERING_RATIO = 16.0
"""A piece is not quartered if its E^2 is at most this times what rounding leaves."""
MAX_RESOLVED_RATIO = 4.0
"""f counts as resolved if the sum of E^2 is at most this times the wanted sum."""
MAX_SOURCE_PIECES = 200_000
"""At most this many pieces of triangles are looked at, or four per triangle of the mesh if that is more."""


@dataclass(frozen=True, eq=False)
class Source:
    """f_h (m, 3) at the triangles' vertices, and what is left of f on each triangle.

    f - f_h is the sum of p - f_h, which is orthogonal to linear functions on triangles, of a function with
    mean 0 that jumps leave, and of another one. Their norms are at most `oscillation`, `jumps` and
    `remainder` (m,), the last of which is E_T. `is_resolved` says whether `remainder` is as small as wanted,
    and `ancestors` where p was found.
    """

    mesh: Mesh
    f_h: Array
    oscillation: Array
    jumps: Array
    remainder: Array
    is_resolved: bool = True
    ancestors: Ancestors | None = None

    @property
    def load(self) -> Array:
        """The load vector (f_h, phi_i), (n,)."""
        load = np.zeros(self.mesh.n_nodes)
        for block in row_blocks(len(self.mesh.triangles)):
            add_moments(load, self.mesh.triangles[block], self.moments(block))
        return load

    def moments(self, triangles: slice = slice(None)) -> Array:
        """The moments of f_h, and so of p, with the hats of some triangles, or of all, (k, 3)."""
        return linear_moments(self.mesh.areas[triangles], self.f_h[triangles])

    @property
    def remainder_norm(self) -> float:
        """A bound on the L2 norm of f - p, the part of f that the polynomials miss."""
        return float(np.linalg.norm(self.remainder))

    @property
    def irreducible_remainder(self) -> float:
        """The part of that norm that hardly falls on finer meshes: all of it, if f is not resolved."""
        return 0.0 if self.is_resolved else self.remainder_norm

    def fill_from_source(self, triangles: Index | slice, source: Source) -> None:
        """Put in a `source` on the triangles `triangles` only, in their order."""
        self.f_h[triangles] = source.f_h
        self.oscillation[triangles] = source.oscillation
        self.jumps[triangles] = source.jumps
        self.remainder[triangles] = source.remainder

    def fill_from_ancestors(self, triangles: Index, ancestors: Ancestors) -> None:
        """Put in f_h and bounds from the ancestors' polynomials on the triangles `triangles` (k,)."""
        mesh = self.mesh
        size = coordinate_scale(mesh)
        for block in row_blocks(len(triangles)):
            some = as_slice(triangles[block])
            area = mesh.areas[some]
            numbers = ancestors.numbers[some]
            corners = corner_coordinates(mesh.points, mesh.triangles[some])
            f_h, squares = project_polynomials(corners, ancestors.polynomials, numbers)
            # E_T = |T|^{1/2} remainder, also on gaps that rounding leaves beside T; 3 d is over T's perimeter
            outer = widen_areas(area, 3 * mesh.longest_edges[some], size)
            self.f_h[some] = f_h.T
            self.oscillation[some] = np.sqrt(area * squares)
            self.jumps[some] = 0.0
            self.remainder[some] = np.sqrt(outer) * ancestors.polynomials.remainder[numbers]

    def piece_sums(self, triangles: Mask) -> PieceSums:
        """The sums over some of the triangles, each of which is one piece."""
        area = self.mesh.areas[triangles]
        f_h = self.f_h[triangles]
        # p - f_h is orthogonal to f_h; what jumps leave counts with p
        p_minus_f_h = self.oscillation[triangles] + self.jumps[triangles]
        p_squares = linear_square_norms(area, f_h) + p_minus_f_h**2
        integral = float(area @ f_h.mean(axis=1))
        remainder_squares = float(np.sum(self.remainder[triangles] ** 2))
        return PieceSums(remainder_squares, float(p_squares.sum()), integral, float(area.sum()), len(area))


def enclose_function(
    mesh: Mesh, f: SourceFunction, coarser: Source | None = None, length_scale: float = 1.0
) -> Source:
    """f on the mesh; `remainder` is infinite where f has no bound, and large where pieces did not suffice.

    `coarser` is f on a mesh from which this one was refined; it is kept where that is enough. For the
    `length_scale` see `relative_mesh_size`.
    """
    n = len(mesh.triangles)
    source = Source(mesh, np.empty((n, 3), order="F"), *np.empty((3, n)))
    ancestors = None
    sums = PieceSums()
    # triangles that were not refined keep their numbers; all others are new to the search, and overwritten
    if coarser:
        source.fill_from_source(slice(len(coarser.f_h)), coarser)
    if coarser and coarser.ancestors:
        ancestors = coarser.ancestors
        sums = coarser.piece_sums(np.ones(len(coarser.f_h), dtype=bool))
    first = coarser.mesh if coarser else mesh.coarse or mesh
    search = AncestorSearch(mesh, f, relative_mesh_size(mesh, length_scale), first, ancestors, sums)
    # triangles of the mesh itself on which no ancestor's polynomial is near enough are quartered
    wide = search.is_new & search.find_coarse_triangles()
    source.fill_from_ancestors(np.flatnonzero(search.is_new & ~wide), search.ancestors)
    sums = search.sums
    if wide.any():
        wide_triangles = np.flatnonzero(wide)
        pieces, sums = _enclose_by_quartering(
            mesh.select_triangles(wide_triangles),
            f,
            length_scale,
            sums=source.piece_sums(~wide),
            max_pieces=max(MAX_SOURCE_PIECES, 4 * n),
        )
        source.fill_from_source(wide_triangles, pieces)
    target = sums.target(relative_mesh_size(mesh, length_scale))
    resolved = float(source.remainder @ source.remainder) <= MAX_RESOLVED_RATIO * target
    return replace(source, is_resolved=resolved, ancestors=search.ancestors)


def enclose_source(
    mesh: Mesh, f: SourceFunction | Array, form: Form, coarser: Source | None = None
) -> Source:
    """f on the mesh: `enclose_function` of a formula, or linear if f has the values (n,) at the nodes."""
    if isinstance(f, np.ndarray):
        return linear_source(mesh, f)
    return enclose_function(mesh, f, coarser, form.length_scale)


def linear_source(mesh: Mesh, f: Array) -> Source:
    """f with the values (n,) at the nodes, linear on every triangle: all of it is known."""
    return Source(mesh, f[mesh.triangles], *np.zeros((3, len(mesh.triangles))))


def _enclose_by_quartering(
    mesh: Mesh, f: SourceFunction, length_scale: float, sums: PieceSums, max_pieces: int
) -> tuple[Source, PieceSums]:
    """f on a part of a mesh, and the `sums` over the rest of it with those over this part added.

    Pieces are quartered until the sum of E^2 meets its target, or `max_pieces` were looked at.
    """
    parent = np.arange(len(mesh.triangles))
    corners = np.broadcast_to(np.eye(3), (len(parent), 3, 3))
    piece_blocks = []
    while parent.size:
        # parts of pieces, which jumps may have cut, and the number of the piece that each is a part of
        pieces, owner = enclose_pieces(mesh, corners, parent, f)
        max_pieces -= len(owner)
        # E^2, where what may lack in the integral is spread over the piece's triangle
        remainder_squares = pieces.remainder_squares + pieces.jump_integral**2 / mesh.areas[pieces.parent]
        p_means = polynomial_means(pieces.c)
        piece_squares = np.bincount(owner, remainder_squares, len(parent)).astype(float)
        # the sums if nothing more were quartered
        total = sums + sum_pieces(p_means, pieces.area, remainder_squares)
        target = total.target(relative_mesh_size(mesh, length_scale))
        # too wide: more than half of an equal share of the target, and more than rounding leaves
        is_wide = piece_squares > (0.5 * target / total.count if total.remainder_squares > target else np.inf)
        is_wide[is_wide] = piece_squares[is_wide] > MIN_QUARTERING_RATIO * attainable_squares(
            mesh, corners[is_wide], parent[is_wide], f
        )
        # if the budget does not suffice for all, the widest ones are quartered
        if 4 * np.count_nonzero(is_wide) > max_pieces:
            is_wide &= np.argsort(np.argsort(-piece_squares)) < max_pieces // 4
        is_done = ~is_wide[owner]
        piece_blocks.append(pieces.select(is_done))
        sums += sum_pieces(p_means[:, is_done], pieces.area[is_done], remainder_squares[is_done])
        corners = quarter(corners[is_wide])
        parent = np.repeat(parent[is_wide], 4)
    return _project_pieces(mesh, piece_blocks), sums


def _project_pieces(mesh: Mesh, piece_blocks: list[TrianglePieces]) -> Source:
    """f_h and bounds on what is left of f, from blocks of pieces that cover the mesh."""
    n = len(mesh.triangles)
    moments = np.zeros((n, 3))  # (p, psi_b) on T
    oscillation_squares, remainder_squares, jump_squares, jump_integrals = np.zeros((4, n))
    for pieces in piece_blocks:
        # psi_b is the sum over a piece's corners of its values there times the piece's own hats
        piece_moments = pieces.area[:, None] * (hat_means() @ pieces.c).T
        np.add.at(moments, pieces.parent, np.einsum("ki,kib->kb", piece_moments, pieces.corners))
        remainder_squares += np.bincount(pieces.parent, pieces.remainder_squares, n)
        jump_squares += np.bincount(pieces.parent, pieces.jump_norm**2, n)
        jump_integrals += np.bincount(pieces.parent, pieces.jump_integral, n)
    # the L2 projection to linear functions, whose mass matrix is |T| (1 + delta_ij) / 12
    f_h = (12 * moments - 3 * moments.sum(axis=1, keepdims=True)) / mesh.areas[:, None]
    for pieces in piece_blocks:
        at_first, at_second, at_third = np.einsum("kib,kb->ik", pieces.corners, f_h[pieces.parent])
        # sigma as in `source_pieces`; coefficients in the order 1, sigma_2, sigma_1. At sigma = 0 f_h is the
        # mean of the last two values; its slopes are half the third, and half the second, less the first
        difference = pieces.c.copy()
        difference[:3] -= 0.5 * np.stack([at_second + at_third, at_third - at_first, at_second - at_first])
        square_means = polynomial_means(difference)[1]
        oscillation_squares += np.bincount(pieces.parent, pieces.outer_area * square_means, n)
    # what jumps leave has a mean of at most jump_integral / |T| on T, of the norm jump_integral / |T|^{1/2}:
    # it goes to E_T, the rest has mean 0
    return Source(
        mesh,
        f_h,
        oscillation=np.sqrt(oscillation_squares),
        jumps=np.sqrt(jump_squares),
        remainder=np.sqrt(remainder_squares) + jump_integrals / np.sqrt(mesh.areas),
    )
