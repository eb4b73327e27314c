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
given, F_0, or G = 2 F_0. They solve a periodic tridiagonal system with a border, which is eliminated for many
patches at once. A spoke has a number: 2 e + i goes from end i of edge e to the other one.

q is given by its values on edges. So whatever rounding does to these values, q is in H(div), with that q.n up
to their rounding.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from unilateral.arrays import Array, Index, Int32, Mask, row_blocks
from unilateral.fem.form import H1, Form
from unilateral.geometry.mesh import Mesh

PATCHES_PER_BLOCK = 4096
"""This many patches, or twice as many triangles, are treated together: their numbers fit into a cache."""
PATCH_REACTION_RATIO = 45.0
"""c |a| / k of a patch above which q_0 counts, too. On many meshes |a| is 3 h^2."""


class _Patches(NamedTuple):
    """Numbers of the triangles T_j (k, p) of p patches.

    `area` is |T|, `divergence` is the integral of div q_1. With b and c for b_j and b_{j+1}, `bb`, `cc` and
    `bc` are |T| times |grad psi_b|^2, |grad psi_c|^2 and grad psi_b . grad psi_c, and `through_b`,
    `through_c` are |T| k times the products of grad psi_b and of grad psi_c with grad u_h. `rise` (k + 1, p)
    is k (u_h(b_j) - u_h(a)). `weight` (p,) is w.
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


class _BorderedSystem(NamedTuple):
    """Equations for z_0, .., z_{k-1} and G = 2 F_0 on each of p patches, periodic and tridiagonal in the z_j.

    Row j has `diagonal` and, for z_{j+1}, `off_diagonal` (k, p). `columns` (3, k, p) are room for the column
    of z_{k-1}, the column of G, which is its row, too, and the load. `border_diagonal` and `border_load` (p,)
    end the row of G.
    """

    diagonal: Array
    off_diagonal: Array
    columns: Array
    border_diagonal: Array
    border_load: Array


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
    next_spoke, f_moments = order_spokes(mesh, moments)
    q = np.zeros((2, len(ends) // 2))
    for boundary_nodes, spokes in gather_patches(mesh, next_spoke):
        a = ends.take(spokes[0])
        b = ends.take(spokes ^ 1)
        patches = _assemble_patches(mesh, u_h, a, b, moments=f_moments.take(spokes[:-1]), form=form)
        if boundary_nodes.size:
            flux_spokes = spokes
            F, z = _solve_boundary_patches(patches, _outer_spoke_fluxes(mesh, sigma, boundary_nodes))
        else:
            flux_spokes = spokes[:-1]  # the last spoke is the first one again
            F, z = _solve_inner_patches(patches)
        # q is the sum of all q_a; on spokes that run against their edge F is the flow to the right, and the
        # values at a are those at the second end, where the tilt counts with the other sign: z stays
        edges = (flux_spokes >> 1).ravel()
        np.add.at(q[0], edges, (F * (1 - 2 * (flux_spokes & 1))).ravel())
        np.add.at(q[1], edges, z.ravel())
    # where sigma is given, q.n is sigma itself, not only up to the rounding of sums; flows are inward there
    boundary = mesh.triangulation.boundary_edges
    inflow = -0.5 * np.diff(mesh.s) * (sigma.T[0] + [[1], [-1]] * sigma.T[1])
    q[:, boundary] = np.where(np.isnan(inflow), q[:, boundary], inflow)
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
    # on the right of its edge a triangle has minus the flow, and the edge's ends in the other order: its
    # values are -(flow - tilt), then -(flow + tilt)
    flow *= 2.0 * is_left - 1.0
    return flow + tilt, flow - tilt


def order_spokes(mesh: Mesh, corner_values: Callable[[slice], Array]) -> tuple[Int32, Array]:
    """For each spoke the next one anticlockwise, and the value at the corner between both, (2 E,) each.

    `corner_values` gives the values (k, 3) at the corners of some triangles. Behind spokes that run back
    along the boundary there is neither: both are 0.
    """
    ends = mesh.triangulation.ends.ravel()
    next_spoke = np.zeros(len(ends), dtype=np.int32)
    value_after = np.zeros(len(ends))
    for block in row_blocks(len(mesh.triangles), 2 * PATCHES_PER_BLOCK):
        node = mesh.triangles[block].T
        edge = mesh.opposite_edges[block].T
        values = corner_values(block).T
        # spokes[i] goes from corner i to the next corner; the spoke from corner i to the one before is
        # spokes[i - 1] turned round, and corner i lies between both
        spokes = [2 * e + (ends.take(2 * e) != a) for e, a in zip(edge[[2, 0, 1]], node, strict=True)]
        for i, spoke in enumerate(spokes):
            value_after[spoke] = values[i]
            next_spoke[spoke] = spokes[i - 1] ^ 1
    return next_spoke, value_after


def gather_patches(mesh: Mesh, next_spoke: Int32) -> Iterator[tuple[Int32, Int32]]:
    """The spokes (k + 1, p) of p nodes with k triangles around each, anticlockwise, one chunk after another.

    The last spoke of a node inside is its first one again. Before the spokes come the numbers (p,) of the
    nodes along the boundary, or none (0,) for nodes inside.
    """
    ends = mesh.triangulation.ends.ravel()
    n = mesh.n_nodes
    first_spoke = np.empty(n, dtype=np.int32)
    number = np.empty(n, dtype=np.int32)
    # a node begins with any spoke, one at the boundary with that along the boundary: no triangle is before it
    first_spoke[ends] = np.arange(len(ends), dtype=np.int32)
    first_spoke[mesh.boundary] = 2 * mesh.triangulation.boundary_edges
    number[mesh.boundary] = np.arange(len(mesh.boundary))
    # a node inside has k spokes and the kind 2 k, one at the boundary has k + 1 spokes and the kind 2 k + 1
    kind = 2 * np.bincount(ends, minlength=n)
    kind[mesh.boundary] -= 1
    for code in np.flatnonzero(np.bincount(kind)):
        nodes = np.flatnonzero(kind == code)
        k, at_boundary = divmod(int(code), 2)
        for block in row_blocks(len(nodes), PATCHES_PER_BLOCK):
            chunk = nodes[block]
            spokes = np.empty((k + 1, len(chunk)), dtype=np.int32)
            spokes[0] = first_spoke[chunk]
            for j in range(k):
                spokes[j + 1] = next_spoke.take(spokes[j])
            yield number[chunk if at_boundary else chunk[:0]], spokes


def _assemble_patches(mesh: Mesh, u_h: Array, a: Int32, b: Int32, moments: Array, form: Form) -> _Patches:
    """The numbers for nodes a (p,), nodes b (k + 1, p) around them, and `moments` (k, p) of f with psi_a."""
    points = mesh.points.ravel()
    # |T| grad psi_b is half of the spoke to c, turned by a right angle, and |T| grad psi_c that to b
    x = points.take(2 * b + 0) - points.take(2 * a + 0)
    y = points.take(2 * b + 1) - points.take(2 * a + 1)
    u = u_h.take(a)
    rise = u_h.take(b) - u
    area = 0.5 * (x[:-1] * y[1:] - y[:-1] * x[1:])
    square = x * x + y * y
    scale = 0.25 / area
    bb = square[1:] * scale
    cc = square[:-1] * scale
    bc = (x[:-1] * x[1:] + y[:-1] * y[1:]) * -scale
    # d = int_T (psi_a (c u_h - f) + k grad psi_a . grad u_h), where grad psi_a = -grad psi_b - grad psi_c;
    # int_T psi_a u_h is |T| / 12 (2 u_h(a) + u_h(b) + u_h(c))
    d = form.c / 12 * area * (4 * u + rise[:-1] + rise[1:]) - moments
    rise *= form.k
    through_b = bb * rise[:-1] + bc * rise[1:]
    through_c = bc * rise[:-1] + cc * rise[1:]
    d -= through_b + through_c
    weight = 1 / np.maximum(1.0, form.c / (PATCH_REACTION_RATIO * form.k) * area.sum(axis=0)) ** 2
    return _Patches(area, d, bb, cc, bc, through_b, through_c, rise, weight)


def _outer_spoke_fluxes(mesh: Mesh, sigma: Array, edge: Int32) -> Array:
    """F and z on the first and on the last spoke of the patches at starts of boundary edges, (2, 2, p).

    F and z are on the first axis, the two spokes, along the edge and the one before, on the second one. On an
    edge from a to b

        q_a.n = sigma(a) + (sigma(b) - sigma(a)) / 6 at a, (sigma(b) - sigma(a)) / 6 at b

    has the integral of psi_a sigma, and with q_b.n the sum sigma. It flows out of the last triangle, and F on
    the first spoke goes into the first one.
    """
    lengths = np.diff(mesh.s)
    fluxes = []
    # near and far are sigma(a) and sigma(b); times |ab|, F is the mean of both values, z half the difference
    for sign, edges, (near, far) in ((-1, edge, sigma[edge].T), (1, edge - 1, sigma[edge - 1].T[::-1])):
        fluxes.append(sign * lengths[edges] * np.stack([near / 3 + far / 6, near / 2]))
    return np.stack(fluxes, axis=1)


def _solve_inner_patches(patches: _Patches) -> Array:
    """F and z on the spokes of patches inside the domain, (2, k, p)."""
    S = _accumulate_flows(patches, 0.0, 0.0)
    z, G = _solve_bordered_periodic(_assemble_system(patches, S, at_boundary=False))
    q_1 = np.stack([S[:-1] + 0.5 * G, z])
    # q_0.n = psi_a times the mean of k grad u_h.n on both sides: F = z = half of that times the length
    q_0 = 0.5 * _sum_at_spokes(patches.through_c, -patches.through_b)
    return q_0 + patches.weight * (q_1 - q_0)


def _solve_boundary_patches(patches: _Patches, outer: Array) -> Array:
    """F and z on the spokes of patches at boundary nodes, (2, k + 1, p).

    `outer` (2, 2, p) is from `_outer_spoke_fluxes`, NaN where the flux is not given. If it is on neither
    spoke, F_0 is an unknown.
    """
    is_given = ~np.isnan(outer[0])
    first_F, last_F = outer[0]
    total_divergence = patches.divergence.sum(axis=0)
    # F_0 is given, or follows from the last F and the divergence, or is S_0 plus the unknown G / 2
    from_last = np.where(is_given[1], last_F - total_divergence, -0.5 * total_divergence)
    S_0 = np.where(is_given[0], first_F, from_last)
    S = _accumulate_flows(patches, S_0, np.where(is_given[1], last_F, S_0 + total_divergence))
    system = _assemble_system(patches, S, at_boundary=True)
    _impose_outer_fluxes(system, outer, is_given)
    z, G = _solve_bordered_periodic(system)
    q_1 = np.stack([S + 0.5 * G, z])
    # q_0 as inside; on outer spokes there is a flux on one side only, and what is given is kept
    q_0 = 0.5 * _sum_at_spokes(patches.through_c, -patches.through_b, at_boundary=True)
    q_0[[0, -1]] *= 2
    q_0 = np.stack([q_0, q_0])
    q_0[:, [0, -1]] = np.where(is_given, outer, q_0[:, [0, -1]])
    return q_0 + patches.weight * (q_1 - q_0)


def _accumulate_flows(patches: _Patches, first_flow: Array | float, last_flow: Array | float) -> Array:
    """F_j (k + 1, p) on the spokes of p patches, from F on the first and on the last one."""
    F = np.empty_like(patches.rise)
    F[0] = first_flow
    # F_{j+1} - F_j is the divergence of T_j, less its part by area of what all have too much in sum
    excess = (patches.divergence.sum(axis=0) - (last_flow - first_flow)) / patches.area.sum(axis=0)
    for j, (d, area) in enumerate(zip(patches.divergence, patches.area, strict=True)):
        np.add(F[j], d - area * excess, out=F[j + 1])
    return F


def _assemble_system(patches: _Patches, S: Array, at_boundary: bool) -> _BorderedSystem:
    """The equations of the least 3 ||k psi_a grad u_h - q_a||^2 for q_a with F_j = S_j + G / 2.

    S (k + 1, p) is from `_accumulate_flows`. On T with F, z on the spoke to b and F', z' on that to c

        2 |T| q_a = (F + z) (c - a) - (F' + z') (b - a) at a, (F - z) (c - b) at b, (F' - z') (c - b) at c.
    """
    # -|T| grad psi_a . grad psi_b, -|T| grad psi_a . grad psi_c and |T| |grad psi_a|^2
    minus_ab = patches.bb + patches.bc
    minus_ac = patches.cc + patches.bc
    aa = minus_ab + minus_ac
    # the second derivatives on T are by z, and by z', bb + cc + bc; by both bc; by G and z -minus_ac, by G
    # and z' -minus_ab; by G 1.5 aa. Loads are minus the first derivatives for z = z' = G = 0
    z_diagonal = patches.bb + patches.cc + patches.bc
    middle = S[:-1] + S[1:]
    twist = 0.25 * (patches.rise[:-1] + patches.rise[1:])
    load = patches.cc * middle + 2 * patches.bc * S[:-1] + twist
    next_load = patches.bb * middle + 2 * patches.bc * S[1:] - twist
    F_terms = minus_ab * S[:-1] + minus_ac * S[1:] + aa * middle
    # what grad u_h gives to the load of G cancels around a node inside
    F_load = 0.5 * (patches.rise[-1] - patches.rise[0]) - F_terms.sum(axis=0)
    diagonal = _sum_at_spokes(z_diagonal, z_diagonal, at_boundary)
    off_diagonal = np.zeros(diagonal.shape)  # at the boundary no triangle is after the last spoke
    off_diagonal[: len(patches.bc)] = patches.bc
    columns = np.zeros((3, *diagonal.shape))
    columns[1] = -_sum_at_spokes(minus_ac, minus_ab, at_boundary)
    columns[2] = _sum_at_spokes(load, next_load, at_boundary)
    border_diagonal = 1.5 * aa.sum(axis=0)
    return _BorderedSystem(diagonal, off_diagonal, columns, border_diagonal, border_load=F_load)


def _sum_at_spokes(following: Array, preceding: Array, at_boundary: bool = False) -> Array:
    """Sums at each spoke of values (k, p) of the triangles beside it; (k + 1, p) at the boundary."""
    if at_boundary:  # outer spokes have one triangle only
        no_triangle = np.zeros((1, following.shape[1]))
        following = np.concatenate([following, no_triangle])
        preceding = np.concatenate([preceding, no_triangle])
    sums = following.copy()
    sums[0] += preceding[-1]
    sums[1:] += preceding[:-1]
    return sums


def _impose_outer_fluxes(system: _BorderedSystem, outer: Array, is_given: Mask) -> None:
    """Put z on outer spokes, and G, into a system in place, where `is_given` (2, p) says that they are known.

    `outer` (2, 2, p) is from `_outer_spoke_fluxes`. The flow that is given is in S, so G = 0 there.
    """
    # z on such a spoke goes to the load beside it, and its own row is that of the identity
    for is_fixed, z, j, beside, link in (
        (is_given[0], outer[1, 0], 0, 1, 0),
        (is_given[1], outer[1, 1], -1, -2, -2),
    ):
        system.columns[2, beside] -= np.where(is_fixed, system.off_diagonal[link] * z, 0.0)
        system.off_diagonal[link, is_fixed] = 0.0
        system.diagonal[j, is_fixed] = 1.0
        system.columns[2, j, is_fixed] = z[is_fixed]
    is_known = is_given.any(axis=0)
    system.columns[1][:, is_known] = 0.0
    system.border_diagonal[is_known] = 1.0
    system.border_load[is_known] = 0.0


def _solve_bordered_periodic(system: _BorderedSystem) -> tuple[Array, Array]:
    """The solutions z (k, p) and G (p,); `diagonal` and `columns` of the system are overwritten.

    z_0, .., z_{k-2} are eliminated, which leaves the two unknowns z_{k-1} and G.
    """
    m = len(system.diagonal) - 1
    last, border, load = system.columns
    # z_{k-1} is beside z_0 and beside z_{k-2}
    last[0] = system.off_diagonal[m]
    last[m - 1] += system.off_diagonal[m - 1]
    over, factors = _eliminate(system.diagonal, system.off_diagonal, system.columns)
    # what is left for z_m and G: ((a, b), (b, c)) (z_m, G) = (r, s)
    a = system.diagonal[m] - (over[0] * last[:m]).sum(axis=0)
    b = border[m] - (over[0] * border[:m]).sum(axis=0)
    r = load[m] - (over[0] * load[:m]).sum(axis=0)
    c = system.border_diagonal - (over[1] * border[:m]).sum(axis=0)
    s = system.border_load - (over[1] * load[:m]).sum(axis=0)
    determinant = a * c - b * b
    z = np.empty_like(system.diagonal)
    z[m] = (c * r - b * s) / determinant
    G = (a * s - b * r) / determinant
    # back substitution
    z[:m] = over[2] - over[0] * z[m] - over[1] * G
    for j in range(m - 2, -1, -1):
        z[j] -= factors[j] * z[j + 1]
    return z, G


def _eliminate(diagonal: Array, off_diagonal: Array, columns: Array) -> tuple[Array, Array]:
    """Gauss's elimination of z_0, .., z_{m-1} from above: `columns` (3, m, p) and `off_diagonal` over pivots.

    The pivots take the place of the first m rows of the `diagonal` (m + 1, p).
    """
    m = len(diagonal) - 1
    for j in range(m - 1):
        factor = off_diagonal[j] / diagonal[j]
        diagonal[j + 1] -= factor * off_diagonal[j]
        columns[:, j + 1] -= factor * columns[:, j]
    inverse = 1 / diagonal[:m]
    return columns[:, :m] * inverse, off_diagonal[:m] * inverse
