"""f enclosed on a mesh: its linear part on every triangle, and a bound on what the rest can do.

On a piece f is near a polynomial p, |f - p| <= rad (`taylor`). On a mesh made by refinement the first pieces
are the triangles of the first mesh; where rad is not small they are replaced by those that came from them
(`source_ancestors`). Triangles of the mesh itself are cut at a jump, where the bound holds but for a part
whose area is bounded (`source_pieces`). Pieces are quartered until sum |piece| rad^2 is small, so that no
peak of f can hide between points. With f_h the L2 projection of p to linear functions on each triangle T,
p - f_h is orthogonal to linear functions there, and E_T >= ||f - p||_T. `residual_norm` has what both can do.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from unilateral.arrays import Array, Index, Mask, blocks
from unilateral.bounds.source_ancestors import FEW, AncestorSearch, Seen, Sums, resolution, sums_of, values
from unilateral.bounds.source_pieces import (
    TrianglePieces,
    averages,
    hat_means,
    known_at_points,
    polynomials,
    rounded_size,
    with_gaps,
)
from unilateral.fem.form import Form
from unilateral.fem.p1 import linear_moments, load_vector
from unilateral.fem.p2 import linear_squares
from unilateral.fem.splitting import quarter
from unilateral.geometry.mesh import Mesh
from unilateral.problems.problem import SourceFunction

IN_VAIN = 16.0
"""A piece is not quartered if its E^2 is at most this times what rounding leaves."""
RESOLVED = 4.0
"""f counts as resolved if the sum of E^2 is at most this times the wanted sum."""
MOST_PIECES = 200_000
"""At most this many pieces are looked at, or four times the number of triangles of the mesh if that is more.

Triangles of coarser levels are not counted.
"""


@dataclass(frozen=True, eq=False)
class Source:
    """f_h (m, 3) at the triangles' vertices, and what is left of f on each triangle.

    f - f_h is the sum of p - f_h, which is orthogonal to linear functions on triangles, of a function with
    mean 0 that jumps leave, and of another one. Their norms are at most `oscillation`, `jumps` and `rest`
    (m,), the last of which is E_T. `resolved` says whether `rest` is as small as wanted, and `seen` where p
    was found.
    """

    mesh: Mesh
    f_h: Array
    oscillation: Array
    jumps: Array
    rest: Array
    resolved: bool = True
    seen: Seen | None = None

    @property
    def load(self) -> Array:
        """(n,) values of (f_h, phi_i)."""
        return load_vector(self.mesh, self.moments())

    def moments(self, of: slice = slice(None)) -> Array:
        """(k, 3) the moments of f_h, and so of p, with the hats of some triangles, or of all."""
        return linear_moments(self.mesh.areas[of], self.f_h[of])

    @property
    def unknown(self) -> float:
        """A bound on the L2 norm of f - p, the part of f that the polynomials miss."""
        return float(np.linalg.norm(self.rest))

    @property
    def irreducible(self) -> float:
        """The part of that norm that hardly falls on finer meshes."""
        return 0.0 if self.resolved else self.unknown

    def put(self, at: Index | slice, of: Source) -> None:
        """Put in what is known on the triangles `at` as those of another mesh."""
        self.f_h[at] = of.f_h
        self.oscillation[at] = of.oscillation
        self.jumps[at] = of.jumps
        self.rest[at] = of.rest

    def put_polynomials(self, at: Index, seen: Seen) -> None:
        """Put in what the polynomials say on the triangles `at` (k,)."""
        mesh = self.mesh
        size = rounded_size(self.mesh)
        places = np.ascontiguousarray(mesh.points.T)
        for some in (at[of] for of in blocks(len(at), FEW)):
            area = mesh.areas[some]
            of = seen.of[some]
            f_h, squares = values(places[:, mesh.triangles[some].T], seen.known, of)
            outer = with_gaps(area, 3 * mesh.longest_edges[some], size)
            self.f_h[some] = f_h.T
            self.oscillation[some] = np.sqrt(area * squares)
            self.jumps[some] = 0.0
            self.rest[some] = np.sqrt(outer) * seen.known.rad[of]

    def sums(self, of: Mask) -> Sums:
        """The sums over some of the triangles."""
        area = self.mesh.areas[of]
        means = self.f_h[of].mean(axis=1)
        squares = linear_squares(area, self.f_h[of]) + (self.oscillation[of] + self.jumps[of]) ** 2
        unknown = float(np.sum(self.rest[of] ** 2))
        return Sums(unknown, float(squares.sum()), float(area @ means), float(area.sum()), len(area))


def enclosed(mesh: Mesh, f: SourceFunction, before: Source | None = None, length: float = 1.0) -> Source:
    """f on the mesh; `rest` is infinite where f has no bound, and large where the pieces did not suffice.

    What is known on a mesh `before`, from which this one was refined, is kept where that is enough. For the
    `length` see `resolution`.
    """
    n = len(mesh.triangles)
    source = Source(mesh, np.empty((n, 3)), *np.empty((3, n)))
    seen = None
    sums = Sums()
    if before:
        source.put(slice(len(before.f_h)), before)
    if before and before.seen:
        seen = before.seen
        sums = before.sums(np.ones(len(before.f_h), dtype=bool))
    first = before.mesh if before else mesh.coarse or mesh
    search = AncestorSearch(mesh, f, resolution(mesh, length), first, seen, sums)
    wide = search.new & search.wide()
    source.put_polynomials(np.flatnonzero(search.new & ~wide), search.seen)
    sums = search.sums
    if wide.any():
        left = np.flatnonzero(wide)
        pieces, sums = _in_pieces(mesh.part(left), f, length, source.sums(~wide), max(MOST_PIECES, 4 * n))
        source.put(left, pieces)
    resolved = float(source.rest @ source.rest) <= RESOLVED * sums.wanted(resolution(mesh, length))
    return replace(source, resolved=resolved, seen=search.seen)


def enclose_source(mesh: Mesh, f: SourceFunction | Array, form: Form, before: Source | None = None) -> Source:
    """f on the mesh, `enclosed`, or linear if it is given at the nodes (n,)."""
    return linear(mesh, f) if isinstance(f, np.ndarray) else enclosed(mesh, f, before, form.length)


def linear(mesh: Mesh, f: Array) -> Source:
    """f with the values (n,) at the nodes, linear on every triangle: all of it is known."""
    return Source(mesh, f[mesh.triangles], *np.zeros((3, len(mesh.triangles))))


def _in_pieces(mesh: Mesh, f: SourceFunction, length: float, sums: Sums, left: int) -> tuple[Source, Sums]:
    """f on a part of a mesh; `sums` are over the rest of the mesh, and `left` pieces may be looked at."""
    n = len(mesh.triangles)
    corners = np.broadcast_to(np.eye(3), (n, 3, 3))
    parent = np.arange(n)
    done = []
    while parent.size:
        pieces, owner = polynomials(mesh, corners, parent, f)
        left -= len(owner)
        # E^2, where what may lack in the integral is spread over the piece's triangle
        rest = pieces.squares + pieces.integral**2 / mesh.areas[pieces.parent]
        area = pieces.area
        of_p = averages(pieces.c)
        squares = np.bincount(owner, rest, len(parent)).astype(float)
        total = sums + sums_of(of_p, area, rest)
        enough = total.wanted(resolution(mesh, length))
        wide = squares > (0.5 * enough / total.count if total.unknown > enough else np.inf)
        wide[wide] = squares[wide] > IN_VAIN * known_at_points(mesh, corners[wide], parent[wide], f)
        if 4 * np.count_nonzero(wide) > left:
            wide &= np.argsort(np.argsort(-squares)) < left // 4
        kept = ~wide[owner]
        done.append(pieces.of(kept))
        sums += sums_of(of_p[:, kept], area[kept], rest[kept])
        corners = quarter(corners[wide])
        parent = np.repeat(parent[wide], 4)
    return _projected(mesh, done), sums


def _projected(mesh: Mesh, done: list[TrianglePieces]) -> Source:
    """f_h and what is left of f, from pieces that cover the mesh."""
    n = len(mesh.triangles)
    moments = np.zeros((n, 3))
    squares = np.zeros(n)
    rest = np.zeros(n)
    jumping = np.zeros(n)
    integral = np.zeros(n)
    for pieces in done:
        own = pieces.area[:, None] * (hat_means() @ pieces.c).T
        np.add.at(moments, pieces.parent, np.einsum("ki,kib->kb", own, pieces.corners))
        rest += np.bincount(pieces.parent, pieces.squares, n)
        jumping += np.bincount(pieces.parent, pieces.jumping**2, n)
        integral += np.bincount(pieces.parent, pieces.integral, n)
    f_h = (12 * moments - 3 * moments.sum(axis=1, keepdims=True)) / mesh.areas[:, None]
    for pieces in done:
        a, b, c = np.einsum("kib,kb->ik", pieces.corners, f_h[pieces.parent])
        left = pieces.c.copy()
        left[:3] -= 0.5 * np.stack([b + c, c - a, b - a])  # of degree 1: (0, 1), (1, 0)
        squares += np.bincount(pieces.parent, pieces.outer * averages(left)[1], n)
    return Source(
        mesh,
        f_h,
        oscillation=np.sqrt(squares),
        jumps=np.sqrt(jumping),
        rest=np.sqrt(rest) + integral / np.sqrt(mesh.areas),
    )
