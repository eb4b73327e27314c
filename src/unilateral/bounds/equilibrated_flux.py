"""A flux q made on vertex patches, which is equilibrated where the mesh is fine; q.n is sigma.

q is the sum of q_a over the nodes a, psi_a the hat of a. q_a lies in BDM1 on the triangles at a, without a
flux through the edges opposite to a, and on boundary edges at a

    q_a.n = a linear function with the integral of psi_a sigma;

on clamped edges q_a.n is free. It is a mean of two such fluxes, w q_1 + (1 - w) q_0. q_1 is equilibrated,

    div q_1 = the mean on each triangle of psi_a (c u_h - f) + k grad psi_a . grad u_h,

and nearest to k psi_a grad u_h in L2. The sum of the hats is 1 and that of their gradients 0, so the sum of
all q_1 has the mean of c u_h - f as its divergence. Divergence and flux of a patch fit together because
k (grad u_h, grad psi_a) + c (u_h, psi_a) = (f, psi_a) + <sigma, psi_a>; what is left of that equation is
spread evenly over the patch, and is found again in div q. At clamped edges they always fit (Braess and
Schoeberl, Math. Comp. 77, 2008; Ern and Vohralik, SIAM J. Numer. Anal. 53, 2015).

q_0.n is psi_a times the mean of k grad u_h.n on both sides of each edge at a. Let J(q_a) be the sum of
k^{-1/2} ||k psi_a grad u_h - q_a|| and of c^{-1/2} times the norm of what div q_a lacks. With |a| the area of
the patch, J(q_1) is at most a multiple of 1 + (c |a| / k)^{1/2} times J(q_0), and J(q_0) one of
1 + (c |a| / k)^{-1/2} times J(q_1). So J(q_a) is at most a multiple of the smaller one of both, for

    w = min(1, PATCH_REACTION_RATIO k / (c |a|))^2.

It is a choice, and only the sharpness of bounds depends on it. On meshes that see the layer of depth
(k/c)^{1/2} w is 1.

The triangles T_0, T_1, .. of a patch are anticlockwise around a, T_j = (a, b_j, b_{j+1}). The flux into T_j
through the spoke from a to b_j, times its length, is linear, with the values F_j + z_j at a and F_j - z_j at
b_j. The divergence determines F_{j+1} - F_j; the unknowns are all z_j and, where no flux into the patch is
given, F_0. They solve a periodic tridiagonal system with a border, which is eliminated for many patches at
once. A spoke has a number: 2 e + i goes from end i of edge e to the other one.

q is given by its values on edges. So whatever rounding does to these values, q is in H(div), with that q.n up
to their rounding.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from unilateral.arrays import Array, Index, Int32, row_blocks
from unilateral.fem.form import H1, Form
from unilateral.geometry.mesh import Mesh

PATCHES_PER_BLOCK = 4096
"""This many patches, or twice as many triangles, are treated together.

Their numbers fit into a processor's cache.
"""
PATCH_REACTION_RATIO = 45.0
"""c |a| / k of a patch above which q_0 counts, too. On many meshes |a| is 3 h^2."""


class _Patches(NamedTuple):
    """Numbers of the triangles T_j (k, p) of p patches.

    `area` is T, `divergence` is the integral of div q_1. With b and c for b_j and b_{j+1}, `bb`, `cc` and
    `bc` are T times |grad psi_b|^2, |grad psi_c|^2 and grad psi_b . grad psi_c, and `through_b`, `through_c`
    are T k times the products of grad psi_b and of grad psi_c with grad u_h. `rise` (k + 1, p) is k (u_h(b_j)
    - u_h(a)). `weight` (p,) is w.
    """

    area: Array
    divergence: Array
    bb: Array
    cc: Array
    bc: Array
    through_b: Array
    through_c: Array
    rise: Array
    weight: Array


def equilibrate_flux(
    mesh: Mesh, u_h: Array, moments: Callable[[slice], Array], sigma: Array, form: Form = H1
) -> Array:
    """q on the edges of the `triangulation`, (2, E): their flows (E,) and tilts (E,).

    The flux over an edge to its left, times the edge's length, is linear along it. At the first end of the
    edge it is the flow plus the tilt, at the second end the flow minus the tilt. `moments` gives the moments
    (k, 3) of f with the hats of some triangles; `sigma` (nb, 2) are the values at the ends of the boundary
    edges of q.n, which is linear there. They are NaN where it is not given.
    """
    ends = mesh.triangulation.ends.ravel()
    boundary = mesh.triangulation.boundary_edges
    after, f = order_spokes(mesh, moments)
    flow, tilt = q = np.zeros((2, len(ends) // 2))
    for edge, spokes in gather_patches(mesh, after):
        a = ends.take(spokes[0])
        b = ends.take(spokes ^ 1)
        patches = _assemble_patches(mesh, u_h, a, b, moments=f.take(spokes[:-1]), form=form)
        if edge.size:
            flux_spokes = spokes
            first_spoke, last_spoke = _outer_spoke_fluxes(mesh, sigma, edge)
            F, z = _solve_boundary_patches(patches, first_spoke, last_spoke)
        else:
            flux_spokes = spokes[:-1]  # the last spoke is the first one again
            F, z = _solve_inner_patches(patches)
        # q is the sum of all q_a; on spokes that run against their edge F is the flow to the right, and the
        # values at a are those at the second end, where the tilt counts with the other sign: z stays
        edges = (flux_spokes >> 1).ravel()
        sign = 1 - 2 * (flux_spokes & 1)
        np.add.at(flow, edges, (F * sign).ravel())
        np.add.at(tilt, edges, z.ravel())
    # where sigma is given, q.n is sigma itself, not only up to the rounding of sums
    q_n = -0.5 * np.diff(mesh.s) * (sigma.T[0] + [[1], [-1]] * sigma.T[1])
    q[:, boundary] = np.where(np.isnan(q_n), q[:, boundary], q_n)
    return q


def triangle_inflows(mesh: Mesh, q: Array, triangles: Index | slice) -> tuple[Array, Array]:
    """The flow into triangles at the first and the second end of the edge opposite to each node, (3, k) each.

    The ends are the two nodes after the opposite one, in this order.
    """
    edge = mesh.opposite_edges[triangles].T
    start = mesh.triangles[triangles].T[[1, 2, 0]]
    is_left = mesh.triangulation.ends.ravel().take(2 * edge) == start
    flow = q[0].take(edge)
    tilt = q[1].take(edge)
    flow *= 2.0 * is_left - 1.0
    return flow + tilt, flow - tilt


def order_spokes(mesh: Mesh, corner_values: Callable[[slice], Array]) -> tuple[Int32, Array]:
    """For each spoke the next one anticlockwise, and the value at the corner between both, (2 E,) each.

    Behind spokes that run back along the boundary there is neither: both are 0.
    """
    ends = mesh.triangulation.ends
    after = np.zeros(2 * len(ends), dtype=np.int32)
    value_after = np.zeros(2 * len(ends))
    for block in row_blocks(len(mesh.triangles), 2 * PATCHES_PER_BLOCK):
        node = mesh.triangles[block].T
        edge = mesh.opposite_edges[block].T
        values = corner_values(block).T
        # corner a of a triangle lies between the spokes along the edges that end and begin at a
        spokes = [2 * e + (ends[e, 0] != a) for e, a in zip(edge[[2, 0, 1]], node, strict=True)]
        for i, spoke in enumerate(spokes):
            value_after[spoke] = values[i]
            after[spoke] = spokes[i - 1] ^ 1
    return after, value_after


def gather_patches(mesh: Mesh, next_spoke: Int32) -> Iterator[tuple[Int32, Int32]]:
    """The spokes (k + 1, p) of p nodes with k triangles around each, anticlockwise, one chunk after another.

    The last spoke of a node inside is its first one again. Before the spokes come the numbers (p,) of the
    nodes along the boundary, or none (0,) for nodes inside.
    """
    ends = mesh.triangulation.ends.ravel()
    n = mesh.n_nodes
    nb = len(mesh.boundary)
    first = np.empty(n, dtype=np.int32)
    number = np.empty(n, dtype=np.int32)
    # patches of one kind have equally many triangles, and all are inside or all at the boundary
    kind = 2 * np.bincount(ends, minlength=n)
    first[ends] = np.arange(len(ends), dtype=np.int32)
    first[mesh.boundary] = 2 * mesh.triangulation.boundary_edges
    number[mesh.boundary] = np.arange(nb)
    kind[mesh.boundary] -= 1
    for code in np.flatnonzero(np.bincount(kind)):
        nodes = np.flatnonzero(kind == code)
        k = code // 2
        for block in row_blocks(len(nodes), PATCHES_PER_BLOCK):
            chunk = nodes[block]
            fan = np.empty((k + 1, len(chunk)), dtype=np.int32)
            fan[0] = first[chunk]
            for j in range(k):
                fan[j + 1] = next_spoke.take(fan[j])
            yield number[chunk[: len(chunk) * (code % 2)]], fan


def _assemble_patches(mesh: Mesh, u_h: Array, a: Int32, b: Int32, moments: Array, form: Form) -> _Patches:
    """The numbers for nodes a (p,), nodes b (k + 1, p) around them, and `moments` (k, p) of f with psi_a."""
    points = mesh.points.ravel()
    # |T| grad psi_b is half of the spoke to c, turned by a right angle, and |T| grad psi_c that to b
    x = points.take(2 * b + 0) - points.take(2 * a + 0)
    y = points.take(2 * b + 1) - points.take(2 * a + 1)
    u = u_h.take(a)
    slope = u_h.take(b) - u
    area = 0.5 * (x[:-1] * y[1:] - y[:-1] * x[1:])
    square = x * x + y * y
    scale = 0.25 / area
    bb = square[1:] * scale
    cc = square[:-1] * scale
    bc = (x[:-1] * x[1:] + y[:-1] * y[1:]) * -scale
    # d = int_T (psi_a (c u_h - f) + k grad psi_a . grad u_h), where grad psi_a = -grad psi_b - grad psi_c
    d = form.c / 12 * area * (4 * u + slope[:-1] + slope[1:]) - moments
    slope *= form.k
    through_b = bb * slope[:-1] + bc * slope[1:]
    through_c = bc * slope[:-1] + cc * slope[1:]
    d -= through_b + through_c
    weight = 1 / np.maximum(1.0, form.c / (PATCH_REACTION_RATIO * form.k) * area.sum(axis=0)) ** 2
    return _Patches(area, d, bb, cc, bc, through_b, through_c, slope, weight)


def _outer_spoke_fluxes(mesh: Mesh, sigma: Array, edge: Int32) -> tuple[Array, Array]:
    """F and z on the first and on the last spoke of the patches at starts of boundary edges, (2, p) each.

    They are those of the flux of q_a into the first triangle and out of the last one. On an edge a, b

        q_a.n = sigma(a) + (sigma(b) - sigma(a)) / 6 at a, (sigma(b) - sigma(a)) / 6 at b.
    """
    lengths = np.diff(mesh.s)
    F_and_z = []
    for sign, edges, (near, far) in ((-1, edge, sigma[edge].T), (1, edge - 1, sigma[edge - 1].T[::-1])):
        F_and_z.append(sign * lengths[edges] * np.stack([near / 3 + far / 6, near / 2]))
    return F_and_z[0], F_and_z[1]


def _quadratic_terms(patches: _Patches, S: Array) -> tuple[Array, Array, Array]:
    """Derivatives of half of what is minimised on each triangle, with F_j = S_j + F_0.

    These are the second derivative by z_j, which is also that by z_{j+1}, and minus the first derivatives by
    z_j and by z_{j+1} where these and F_0 are 0. The mixed second derivative is `bc`.
    """
    middle = S[:-1] + S[1:]
    twist = 0.25 * (patches.rise[:-1] + patches.rise[1:])
    mixed = 2 * patches.bc
    load = patches.cc * middle + mixed * S[:-1]
    load_next = patches.bb * middle + mixed * S[1:]
    load += twist
    load_next -= twist
    return patches.bb + patches.cc + patches.bc, load, load_next


def _accumulate_flows(patches: _Patches, first_flow: Array | float, last_flow: Array | float) -> Array:
    """F_j on the spokes, from F on the first and on the last one, (k + 1, p)."""
    F = np.empty_like(patches.rise)
    F[0] = first_flow
    # F_{j+1} - F_j is the divergence of T_j, less its part by area of what all have too much in sum
    lacking = (patches.divergence.sum(axis=0) - (last_flow - first_flow)) / patches.area.sum(axis=0)
    for j, (d, area) in enumerate(zip(patches.divergence, patches.area, strict=True)):
        np.add(F[j], d - area * lacking, out=F[j + 1])
    return F


def _solve_inner_patches(patches: _Patches) -> Array:
    """F and z on the spokes of patches inside the domain, (2, k, p).

    The unknown of the border is 2 F_0.
    """
    S = _accumulate_flows(patches, 0.0, 0.0)
    # second derivatives by 2 F_0 and z_j: -with_c, z_{j+1}: -with_b, and 2 F_0 again: 1.5 (with_b + with_c)
    with_b = patches.bb + patches.bc
    with_c = patches.cc + patches.bc
    z_diagonal, load, load_next = _quadratic_terms(patches, S)
    with_both = with_b + with_c
    F_terms = with_b * S[:-1] + with_c * S[1:] + with_both * (S[:-1] + S[1:])
    # the columns of z_{k-1} (made later), of 2 F_0 and of the load
    columns = np.zeros((3, *z_diagonal.shape))
    columns[1] = -_sum_at_spokes(with_c, with_b)
    columns[2] = _sum_at_spokes(load, load_next)
    z, F = _solve_bordered_periodic(
        diagonal=_sum_at_spokes(z_diagonal, z_diagonal),
        off_diagonal=patches.bc,
        columns=columns,
        border_diagonal=1.5 * with_both.sum(axis=0),
        border_load=-F_terms.sum(axis=0),
    )
    # q_0.n = psi_a times the mean of k grad u_h.n on both sides: F = z = half of that times the length
    q_0 = 0.5 * _sum_at_spokes(patches.through_c, -patches.through_b)
    return q_0 + patches.weight * (np.stack([S[:-1] + 0.5 * F, z]) - q_0)


def _sum_at_spokes(following: Array, preceding: Array) -> Array:
    """The sums at each spoke of the values of the triangles after and before it, (k, p)."""
    sums = following.copy()
    sums[0] += preceding[-1]
    sums[1:] += preceding[:-1]
    return sums


def _solve_bordered_periodic(
    diagonal: Array, off_diagonal: Array, columns: Array, border_diagonal: Array, border_load: Array
) -> tuple[Array, Array]:
    """The solutions z and F of systems that are periodic and tridiagonal, with one border.

    z_0, .., z_{k-2} are eliminated, which leaves two unknowns, z_{k-1} and F. Their columns, of which the
    first one is made here, and the load are `columns` (3, k, p). These and `diagonal` are overwritten.
    """
    m = len(diagonal) - 1
    last, border, load = columns
    last[0] = off_diagonal[m]
    last[m - 1] += off_diagonal[m - 1]
    # eliminate z_0, .., z_{m-1} from above
    for j in range(m - 1):
        factor = off_diagonal[j] / diagonal[j]
        diagonal[j + 1] -= factor * off_diagonal[j]
        columns[:, j + 1] -= factor * columns[:, j]
    inverse = 1 / diagonal[:m]
    over = columns[:, :m] * inverse
    factors = off_diagonal[:m] * inverse
    # what is left for z_m and F: ((a, b), (b, c)) (z_m, F) = (r, s)
    a = diagonal[m] - _column_dots(over[0], last[:m])
    b = border[m] - _column_dots(over[0], border[:m])
    r = load[m] - _column_dots(over[0], load[:m])
    c = border_diagonal - _column_dots(over[1], border[:m])
    s = border_load - _column_dots(over[1], load[:m])
    z = np.empty_like(diagonal)
    determinant = a * c - b * b
    z[m] = (c * r - b * s) / determinant
    F = (a * s - b * r) / determinant
    # back substitution
    z[:m] = over[2] - over[0] * z[m] - over[1] * F
    for j in range(m - 2, -1, -1):
        z[j] -= factors[j] * z[j + 1]
    return z, F


def _column_dots(a: Array, b: Array) -> Array:
    """The sums of the products of two arrays, column by column, (p,)."""
    return np.asarray((a * b).sum(axis=0))


def _solve_boundary_patches(patches: _Patches, first_spoke: Array, last_spoke: Array) -> Array:
    """F and z on the spokes of patches at boundary nodes, from those on the outer spokes, (2, k + 1, p).

    Where the flux through an outer spoke is not given these are NaN, and F_0, if neither is, is an unknown.
    """
    is_given = ~np.isnan([first_spoke[0], last_spoke[0]])
    total_divergence = patches.divergence.sum(axis=0)
    # F_0 is given, or follows from the last F and the divergence, or is this plus an unknown
    from_last = np.where(is_given[1], last_spoke[0] - total_divergence, -0.5 * total_divergence)
    F_0 = np.where(is_given[0], first_spoke[0], from_last)
    S = _accumulate_flows(patches, F_0, np.where(is_given[1], last_spoke[0], F_0 + total_divergence))
    z_diagonal, load, load_next = _quadratic_terms(patches, S)
    with_b = patches.bb + patches.bc
    with_c = patches.cc + patches.bc
    # the system of a patch inside, without a triangle before the first spoke and after the last one
    no_triangle = np.zeros((1, S.shape[1]))
    columns = np.zeros((3, *S.shape))
    diagonal = np.concatenate([z_diagonal, no_triangle]) + np.concatenate([no_triangle, z_diagonal])
    columns[1] = np.concatenate([-with_c, no_triangle]) + np.concatenate([no_triangle, -with_b])
    columns[2] = np.concatenate([load, no_triangle]) + np.concatenate([no_triangle, load_next])
    off_diagonal = np.concatenate([patches.bc, no_triangle])
    # z on a spoke where the flux is given is known, and its row is that of the identity
    for fixed, j, beside, next_, z in (
        (is_given[0], 0, 0, 1, first_spoke[1]),
        (is_given[1], -1, -2, -2, last_spoke[1]),
    ):
        columns[2, next_] -= np.where(fixed, off_diagonal[beside] * z, 0.0)
        off_diagonal[beside, fixed] = 0.0
        diagonal[j, fixed] = 1.0
        columns[1, j, fixed] = 0.0
        columns[2, j, fixed] = z[fixed]
    # F_0 is no unknown where one of both fluxes is given
    free = ~is_given.any(axis=0)
    with_both = with_b + with_c
    columns[1, :, ~free] = 0.0
    F_terms = with_b * S[:-1] + with_c * S[1:] + with_both * (S[:-1] + S[1:])
    F_load = 0.5 * (patches.rise[-1] - patches.rise[0]) - F_terms.sum(axis=0)  # slopes cancel inside
    F_diagonal = np.where(free, 1.5 * with_both.sum(axis=0), 1.0)
    z, F = _solve_bordered_periodic(diagonal, off_diagonal, columns, F_diagonal, np.where(free, F_load, 0.0))
    # q_0: on outer spokes there is a flux on one side only, and what is given is kept
    after = np.concatenate([patches.through_c, no_triangle])
    before = np.concatenate([no_triangle, patches.through_b])
    mean = 0.5 * (after - before)
    mean[[0, -1]] *= 2
    q_0 = np.stack([mean, mean])
    for fixed, j, spoke in ((is_given[0], 0, first_spoke), (is_given[1], -1, last_spoke)):
        q_0[:, j] = np.where(fixed, spoke, q_0[:, j])
    return q_0 + patches.weight * (np.stack([S + 0.5 * F, z]) - q_0)
