"""A flux q equilibrated on vertex patches: div q is the mean of u_h - f on triangles, q.n is sigma.

q is the sum of q_a over the nodes a, psi_a the hat of a. q_a lies in BDM1 on the triangles at a, without a
flux through the edges opposite to a, and

    div q_a = the mean on each triangle of psi_a (u_h - f) + grad psi_a . grad u_h,
    q_a.n   = a linear function with the integral of psi_a sigma, on boundary edges at a,

nearest to psi_a grad u_h in L2. The sum of the hats is 1 and that of their gradients 0, whence div q.
Divergence and flux of a patch fit together because (u_h, psi_a)_1 = (f, psi_a) + <sigma, psi_a>; what is left
of that equation is spread evenly over the patch, and is found again in div q (Braess and Schoeberl, Math.
Comp. 77, 2008; Ern and Vohralik, SIAM J. Numer. Anal. 53, 2015).

The triangles T_0, T_1, .. of a patch are anticlockwise around a, T_j = (a, b_j, b_{j+1}). The flux into T_j
through the spoke from a to b_j, times its length, is linear, with the values F_j + z_j at a and F_j - z_j at
b_j. The divergence says F_{j+1} - F_j; what is sought are all z_j and, inside the domain, F_0: the solution
of a periodic tridiagonal system with a border, which is eliminated for many patches at once.

q is told by its values on edges, so that whatever rounding does to them, q is in H(div) and has that q.n.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from unilateral.arrays import Array, Index, Int32
from unilateral.geometry.mesh import Mesh

CHUNK = 4096
"""Patches, or twice as many triangles, at a time: their numbers fit into a processor's cache."""


class _Corners(NamedTuple):
    """Numbers of every corner, (3 m,): corner i m + t is that of triangle t at its node i, which is a here.

    b and c are the two nodes after a, and T is the area. These are T, the integral of div q_a, the T-fold
    squares of grad psi_b and grad psi_c, and their product, and the T-fold product of grad u_h with
    grad psi_c - grad psi_b, and with their sum, both turned to the left.
    """

    area: Array
    d: Array
    bb: Array
    cc: Array
    bc: Array
    twist: Array
    drift: Array


def equilibrated(mesh: Mesh, u_h: Array, moments: Array, sigma: Array) -> Array:
    """q on the triangles (2, 3, m): what flows in through the edge from node i to the next, times its length.

    That is linear, and these are its values at the two nodes. `moments` (m, 3) are those of f with the hats;
    `sigma` (nb, 2) is linear on the boundary edges, with these values at their ends.
    """
    corners, beyond = _corners(mesh, u_h, moments), _beyond(mesh)
    at, m = mesh.boundary_triangles, len(mesh.triangles)
    at_edge = m * np.argmax(mesh.triangles[at] == mesh.boundary[:, None], axis=1) + at
    spokes = np.empty((2, 3 * m))
    for nodes, fan in _fans(mesh, beyond[[1, 2, 0]].ravel(), at_edge):
        of = _Corners(*corners[:, fan])
        inside = len(nodes) == 0
        spokes[:, fan] = _inside(of) if inside else _at_the_boundary(of, *_given(mesh, sigma, nodes))
    flux = spokes - spokes[::-1, beyond[[2, 0, 1]].ravel()]
    flux[:, at_edge] = -np.diff(mesh.s) * sigma.T
    return flux.reshape(2, 3, m)


def _corners(mesh: Mesh, u_h: Array, moments: Array) -> Array:
    """(7, 3 m) the numbers of `_Corners`."""
    m = len(mesh.triangles)
    found = np.empty((len(_Corners._fields), 3, m))
    points, (b, c) = np.ascontiguousarray(mesh.points.T), ([1, 2, 0], [2, 0, 1])
    for of in (slice(begin, begin + 2 * CHUNK) for begin in range(0, m, 2 * CHUNK)):
        node, area = np.ascontiguousarray(mesh.triangles[of].T), mesh.areas[of]
        u, (x, y) = u_h[node], points[:, node]
        e, f = x[c] - x[b], y[c] - y[b]
        squares, mixed = ((e * g + f * h) / (4 * area) for g, h in ((e, f), (e[b], f[b])))
        mixed = mixed[b]
        d = area / 12 * (u + u.sum(axis=0)) - moments[of].T
        d += squares * u + mixed[c] * u[b] + mixed[b] * u[c]
        twist, drift = u - 0.5 * (u[b] + u[c]), 0.5 * (u[c] - u[b])
        for place, values in zip(found, (area, d, squares[b], squares[c], mixed, twist, drift), strict=True):
            place[:, of] = values
    return found.reshape(-1, 3 * m)


def _beyond(mesh: Mesh) -> Int32:
    """(3, m) the corner after the one across the edge opposite to each corner; any corner at the boundary.

    It lies at the node after, and its edge is the next corner's, the other way.
    """
    edge = np.ascontiguousarray(mesh.opposite_edges.T).ravel()
    corner = np.arange(len(edge), dtype=np.int32)
    first, last = np.empty((2, len(mesh.triangulation.ends)), dtype=np.int32)
    last[edge], first[edge[::-1]] = corner, corner[::-1]
    across = np.where(last[edge] == corner, first[edge], last[edge]) + np.int32(len(edge) // 3)
    across[across >= len(edge)] -= len(edge)
    return across.reshape(3, -1)


def _fans(mesh: Mesh, following: Int32, at_edge: Index) -> Iterator[tuple[Index, Int32]]:
    """Of p nodes with k triangles around each the corners (k, p), anticlockwise, a chunk after the other.

    With them the numbers (p,) of nodes along the boundary, or none (0,). `following` (3 m,) is the corner at
    the same node in the next triangle.
    """
    node, n = mesh.triangles.T.ravel(), mesh.n_nodes
    first, number, valence = np.empty(n, dtype=np.int32), np.full(n, -1), np.bincount(node, minlength=n)
    first[node] = np.arange(len(node))
    first[mesh.boundary], number[mesh.boundary] = at_edge, np.arange(len(at_edge))
    for k in np.unique(valence):
        for inside in (number < 0, number >= 0):
            nodes = np.flatnonzero(inside & (valence == k))
            for part in np.array_split(nodes, len(nodes) // CHUNK + 1) if len(nodes) else []:
                fan = [first[part]]
                for _ in range(k - 1):
                    fan.append(following[fan[-1]])
                yield number[part[number[part] >= 0]], np.array(fan)


def _given(mesh: Mesh, sigma: Array, edge: Index) -> tuple[Array, Array]:
    """The flux of q_a through the first and the last spoke of nodes at which boundary edges begin, (2, p).

    It flows into the first triangle and out of the last one; these are F + z and F - z. On an edge a, b

        q_a.n = sigma(a) + (sigma(b) - sigma(a)) / 6 at a, (sigma(b) - sigma(a)) / 6 at b.
    """
    lengths = np.diff(mesh.s)
    found = []
    for sign, at, (near, far) in ((-1, edge, sigma[edge].T), (1, edge - 1, sigma[edge - 1].T[::-1])):
        tilt = (far - near) / 6
        found.append(sign * lengths[at] * np.stack([near + tilt, tilt]))
    return found[0], found[1]


def _terms(of: _Corners, S: Array, T: Array) -> tuple[Array, ...]:
    """Derivatives of what is minimised on each triangle, for F_j = S + F_0 and F_{j+1} = T + F_0.

    The second ones by z_j or z_{j+1} twice, and by both; by F_0 and z_j, F_0 and z_{j+1}, F_0 twice; then
    minus the first ones by z_j, z_{j+1} and F_0 where these are 0.
    """
    with_b, with_c = of.bb + of.bc, of.cc + of.bc
    both = with_b + with_c
    sum_, mixed = S + T, 4 * of.bc
    return (
        of.bb + of.cc + both,
        2 * of.bc,
        -4 * with_c,
        -4 * with_b,
        12 * both,
        2 * of.cc * sum_ + mixed * S - of.twist,
        2 * of.bb * sum_ + mixed * T + of.twist,
        4 * (of.drift - with_b * S - with_c * T - both * sum_),
    )


def _inside(of: _Corners) -> Array:
    """(2, k, p) F + z and F - z on the spokes of p nodes with k triangles around each."""
    d = of.d - of.area * (of.d.sum(axis=0) / of.area.sum(axis=0))
    T = np.cumsum(d, axis=0)
    S = T - d
    own, off, by_z, by_next, by_F, load, load_next, load_F = _terms(of, S, T)
    diagonal, load = own + np.roll(own, 1, axis=0), load + np.roll(load_next, 1, axis=0)
    border = by_z + np.roll(by_next, 1, axis=0)
    z, F = _periodic(diagonal, off, border, by_F.sum(axis=0), load, load_F.sum(axis=0))
    return np.stack([F + S + z, F + S - z])


def _periodic(
    diagonal: Array, off: Array, border: Array, corner: Array, load: Array, last_load: Array
) -> tuple[Array, Array]:
    """z (k, p) and F (p,) of p systems: periodic, tridiagonal, `off` between z_j and z_{j+1}, and a border.

    z_0, .., z_{k-2} are eliminated, which leaves two unknowns, z_{k-1} and F. The arrays are overwritten.
    """
    m = len(diagonal) - 1
    last = np.zeros_like(diagonal)
    last[0], last[m - 1] = off[m], last[m - 1] + off[m - 1]
    for j in range(m - 1):
        factor = off[j] / diagonal[j]
        diagonal[j + 1] -= factor * off[j]
        for column in (last, border, load):
            column[j + 1] -= factor * column[j]
    by_last, by_border = (column[:m] / diagonal[:m] for column in (last, border))
    a, r = (x[m] - (by_last * y[:m]).sum(axis=0) for x, y in ((diagonal, last), (load, load)))
    b = border[m] - (by_last * border[:m]).sum(axis=0)
    c, s = (x - (by_border * y[:m]).sum(axis=0) for x, y in ((corner, border), (last_load, load)))
    z = np.empty_like(diagonal)
    z[m], F = (c * r - b * s) / (a * c - b**2), (a * s - b * r) / (a * c - b**2)
    z[:m] = (load[:m] - last[:m] * z[m] - border[:m] * F) / diagonal[:m]
    for j in range(m - 2, -1, -1):
        z[j] -= off[j] / diagonal[j] * z[j + 1]
    return z, F


def _at_the_boundary(of: _Corners, into: Array, out: Array) -> Array:
    """The same of p nodes at the boundary, (2, k, p) without the last spoke."""
    first, last = into.mean(axis=0), out.mean(axis=0)
    d = of.d - of.area * ((of.d.sum(axis=0) - (last - first)) / of.area.sum(axis=0))
    T = first + np.cumsum(d, axis=0)
    S, k = T - d, len(d)
    own, off, _, _, _, load, load_next, _ = _terms(of, S, T)
    diagonal, load = own[1:] + own[:-1], load[1:] + load_next[:-1]
    z = np.zeros((k + 1, d.shape[1]))
    z[0], z[k] = into[0] - first, out[0] - last
    if k > 1:
        load[0] -= off[0] * z[0]
        load[-1] -= off[-1] * z[k]
    for j in range(k - 2):
        factor = off[j + 1] / diagonal[j]
        diagonal[j + 1] -= factor * off[j + 1]
        load[j + 1] -= factor * load[j]
    for j in range(k - 2, -1, -1):
        z[j + 1] = (load[j] - (off[j + 1] * z[j + 2] if j < k - 2 else 0)) / diagonal[j]
    return np.stack([S + z[:k], S - z[:k]])
