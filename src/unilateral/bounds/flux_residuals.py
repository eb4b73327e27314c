"""k grad v - q and f + div q - c v on triangles, for a flux q that is given on edges, as by `equilibrated`.

Their norms are those of `residual_norm`. Where (k/c)^{1/2} is smaller than a triangle T, there is another
bound on what T adds for a linear v. As (q - k grad v).n is linear on the edges e of T, by parts

    (q - k grad v, grad z)_T + (f + div q - c v, z)_T = (f - c v, z)_T + sum_e <(q - k grad v).n, z>_e.

Let a_e = (|e|/|T|)^{1/2} ||(q - k grad v).n||_e, let x_0 be the mean of the vertices off the edges e with the
weights a_e, and R its greatest distance from a vertex. The divergence theorem with the field x - x_0 gives

    s' = c^{-1/2} ||f - c v||_T + ((1 + (1 + R^2 c/k)^{1/2}) / (2 c))^{1/2} sum_e a_e.

What the exact mesh adds to the norms (`geometry.exact_mesh`) is counted with the rounding. On a triangle
with the `distortion` eps it is eps |q| and eps |div q|, and at edges eps k |grad v|, too. At the boundary it
is also what the sides' `stretch` changes of the flow through an edge, so that q.n on the exact boundary is
what it is on this one (Proposition S7).
"""

from __future__ import annotations

import math

import numpy as np

from unilateral.arrays import Array, Index, blocks
from unilateral.bounds.boundary_flux import Given
from unilateral.bounds.equilibrated_flux import flows
from unilateral.bounds.residual_norm import UNDERFLOW, ResidualParts
from unilateral.bounds.source import Source
from unilateral.fem.form import Form
from unilateral.fem.p2 import Layer, linear_squares, slopes_at_nodes, squares
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.refinement import CORNERS
from unilateral.norms.oscillation import value_constants

ROUNDING = 2.0**-45
"""The rounding of a sum, over its terms' sizes: 128 units in the last place, for some 20 operations each."""


def misfit(mesh: Mesh, u_h: Array, q: Array, of: Index | slice, k: float = 1.0) -> Array:
    """(m, 3, 2) k grad u_h - q at the nodes of those triangles."""
    node = mesh.triangles[of].T
    return _misfit(mesh, node, k * u_h.take(node), flows(mesh, q, of), mesh.areas[of]).transpose(2, 1, 0)


def _misfit(mesh: Mesh, node: Index, u: Array, ends: tuple[Array, Array], area: Array) -> Array:
    """(2, 3, m) grad u - q, from the nodes, u there (3, m), and the `flows`.

    At a node the flow in through the edge to the next node and the flow out through the edge from the node
    before determine q.
    """
    (first, last) = ends
    found = np.empty((2, *u.shape), dtype=u.dtype)
    points = mesh.points.ravel()
    x = points.take(2 * node)
    y = points.take(2 * node + 1)
    along = [[z[k] - z[j] for _, j, k in CORNERS] for z in (x, y)]
    for values, e, sign, f in zip(found, along, (-1, 1), along[::-1], strict=True):
        slope = sign * (u[0] * f[0] + u[1] * f[1] + u[2] * f[2])
        for i, j, k in CORNERS:
            np.add(slope, e[j] * first[k] - e[k] * last[j], out=values[i])
    found *= 0.5 / area
    return found


def residual_parts(source: Source, tau: Given, u_h: Array, q: Array, form: Form) -> ResidualParts:
    """The parts of the residual of u_h (n,) in V_h."""
    mesh = source.mesh
    # s' is not stored where no triangle needs it
    by_parts = np.broadcast_to(math.inf, len(mesh.triangles))
    if form.c * mesh.diameter**2 > form.k:
        by_parts = by_parts.copy()
    # one array for the stretched divergence and then `rest`, which takes its place block by block
    stretched = stretched_divergence(mesh, q)
    parts = ResidualParts(
        mesh,
        form,
        misfit=np.empty_like(mesh.areas),
        oscillation=np.empty_like(mesh.areas),
        mean=np.empty_like(mesh.areas),
        rest=stretched,
        by_parts=by_parts,
    )
    for of in blocks(len(mesh.triangles)):
        _put(parts, of, source, q, stretched[of], u_h.take(mesh.triangles[of].T))
    put_tau(parts, tau)
    return parts


def move_parts(
    parts: ResidualParts,
    source: Source,
    tau: Given,
    u_h: Array,
    q: Array,
    layer: Layer,
    hats: Array,
    bubbles: Array,
) -> None:
    """Make the parts for u_h those for u_h + y; y has these coefficients (m, 3) on the layer's triangles.

    There s' becomes infinite.
    """
    v = u_h.take(parts.mesh.triangles[layer.triangles].T) + hats.T
    stretched = stretched_divergence(parts.mesh, q)[layer.triangles]
    _put(parts, layer.triangles, source, q, stretched, v, layer.slopes, bubbles)
    put_tau(parts, tau)


def _put(
    parts: ResidualParts,
    of: slice | Index,
    source: Source,
    q: Array,
    stretched: Array,
    v: Array,
    slopes: Array | None = None,
    bubbles: Array | None = None,
) -> None:
    """Put in the parts on some triangles, but for rho of `boundary_flux`.

    v has the values (3, m) at their nodes. It may have `bubbles` (m, 3), which takes the hats' `slopes`.
    """
    mesh = parts.mesh
    form = parts.form
    k = form.k
    c = form.c
    area = mesh.areas[of]
    ends = flows(mesh, q, of)
    f_h = source.f_h[of].T
    field = _misfit(mesh, mesh.triangles[of].T, k * v, ends, area)
    divergence = -0.5 * (_sum(ends[0]) + _sum(ends[1])) / area

    # the mean of f_h - c v, and the norm of p - c v less that
    g = f_h - c * v
    if bubbles is None or slopes is None:
        size = _largest(np.abs(v))
        mean = _sum(g) / 3
        linear = area / 36 * ((g[1] - g[0]) ** 2 + (g[2] - g[1]) ** 2 + (g[0] - g[2]) ** 2)
        # p - f_h is orthogonal to a linear f_h - c v
        mean_free = np.sqrt(linear + source.oscillation[of] ** 2)
    else:
        size = _largest(np.abs(v)) + np.abs(bubbles).sum(axis=1)
        field += k * slopes_at_nodes(slopes, 0 * bubbles, bubbles).transpose(2, 1, 0)
        mean = (_sum(g) - c * bubbles.sum(axis=1)) / 3
        mean_free = np.sqrt(squares(area, (g - mean).T, -c * bubbles)) + source.oscillation[of]
    more_field, more_rho = allowances(mesh, of, size, f_h, ends, form, stretched)
    length = np.sqrt(area)
    parts.misfit[of] = np.sqrt(linear_squares(area, field.transpose(2, 1, 0))) + length * more_field
    parts.oscillation[of] = mean_free + source.jumps[of]
    parts.mean[of] = length * np.abs(mean + divergence)
    parts.rest[of] = source.rest[of] + length * more_rho

    # s', which is for linear v
    thick = np.flatnonzero(c * mesh.longest_edges[of] ** 2 > k)
    if thick.size and bubbles is not None:
        parts.by_parts[of] = math.inf
    elif thick.size:
        rows = np.arange(len(parts.misfit))[of][thick]
        inside = np.sqrt(mean_free**2 + area * mean**2) + source.jumps[of] + parts.rest[of]
        parts.by_parts[rows] = by_parts(mesh, rows, field[..., thick], inside[thick], more_field[thick], form)


def by_parts(mesh: Mesh, of: Index, field: Array, inside: Array, more: Array, form: Form) -> Array:
    """(m,) s' on the triangles `of` (m,), for c > 0.

    The `field` k grad v - q has these values (2, 3, m) at the nodes, up to `more` (m,); `inside` (m,) are
    bounds on ||f - c v||_T.
    """
    # the exact mesh changes grad v, too, and k |grad v| is at most |q - k grad v| + |q|
    added = 2 * more + mesh.distortion[of] * _largest(np.hypot(field[0], field[1]))
    corners = mesh.points[mesh.triangles[of]].transpose(2, 1, 0)
    area = mesh.areas[of]
    through = np.empty((3, len(of)))
    for i, j, k in CORNERS:
        x, y = corners[:, k] - corners[:, j]
        length = np.hypot(x, y)
        start = (field[0, j] * y - field[1, j] * x) / length
        end = (field[0, k] * y - field[1, k] * x) / length
        norm = np.sqrt(length / 3 * (start**2 + start * end + end**2)) + np.sqrt(length) * added
        through[i] = np.sqrt(length / area) * norm
    total = _sum(through)
    centre = (through * corners).sum(axis=1) / total
    R = _largest(np.hypot(*(corners - centre[:, None])))
    constant = np.sqrt((1 + np.sqrt(1 + R**2 * (form.c / form.k))) / (2 * form.c))
    return np.asarray(inside / math.sqrt(form.c) + constant * total)


def allowances(
    mesh: Mesh,
    of: slice | Index,
    size: Array,
    f_h: Array,
    ends: tuple[Array, Array],
    form: Form,
    stretched: Array,
) -> tuple[Array, Array]:
    """(m,), (m,) what rounding and the exact mesh may add to |k grad v - q| and |f_h + div q - c v|.

    It is at least UNDERFLOW, below which squares may be 0.

    That is on some triangles, where v is at most `size` (m,) in its coefficients, f_h has the values (3, m)
    at nodes, and q the `flows` there.
    """
    area = mesh.areas[of]
    longest = mesh.longest_edges[of]
    distortion = mesh.distortion[of]
    over = 1 / area
    flow = np.abs(_sum(ends[0]) + _sum(ends[1]))
    first = np.abs(ends[0])
    last = np.abs(ends[1])
    most = _largest([first[k] + last[j] for _, j, k in CORNERS])
    flows_in = _sum(first) + _sum(last)
    field = longest * over * (ROUNDING * (form.k * size + flows_in) + 0.5 * distortion * most)
    rho = ROUNDING * (form.c * size + _largest(np.abs(f_h)) + flows_in * over)
    rho += 0.5 * distortion * flow * over + stretched
    return field + longest * stretched + UNDERFLOW, rho + UNDERFLOW


def stretched_divergence(mesh: Mesh, q: Array) -> Array:
    """(m,) bounds on |div q_T|, where q_T has the `stretch` of a side times the flow of q there.

    |q_T| is at most that times the longest edge.
    """
    at = mesh.boundary_triangles
    found = np.zeros(len(mesh.triangles))
    flow, tilt = q[:, mesh.triangulation.boundary]
    flow = mesh.polygon.stretch[mesh.side] * (np.abs(flow + tilt) + np.abs(flow - tilt))
    np.add.at(found, at, 0.5 * flow / mesh.areas[at])
    return found


def put_tau(parts: ResidualParts, tau: Given) -> None:
    """Put in rho, which is not known of the flux that is given on free sides, on the triangles there."""
    mesh = parts.mesh
    form = parts.form
    at = mesh.boundary_triangles
    np.add.at(parts.misfit, at, tau.misfit(mesh))
    np.add.at(parts.rest, at, tau.rest(mesh))
    if form.c and parts.by_parts.flags.writeable:
        np.add.at(parts.by_parts, at, np.sqrt(value_constants(mesh, form)) * tau.size)


def _sum(of: Array) -> Array:
    """(m,) the sum of the three rows; this is faster than a reduction."""
    return np.asarray(of[0] + of[1] + of[2])


def _largest(of: Array | list[Array]) -> Array:
    return np.asarray(np.maximum(np.maximum(of[0], of[1]), of[2]))
