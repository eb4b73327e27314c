"""k grad v - q and f + div q - c v on triangles, for a flux q given on edges, as by `equilibrate_flux`.

Their norms are those of `residual_norm`. Where (k/c)^{1/2} is smaller than a triangle T, there is another
bound on what T adds for a linear v. As (q - k grad v).n is linear on the edges e of T, by parts

    (q - k grad v, grad z)_T + (f + div q - c v, z)_T = (f - c v, z)_T + sum_e <(q - k grad v).n, z>_e.

Let a_e = (|e|/|T|)^{1/2} ||(q - k grad v).n||_e, let x_0 be the mean of the vertices off the edges e with the
weights a_e, and R its greatest distance from a vertex. The divergence theorem with the field x - x_0 gives

    s' = c^{-1/2} ||f - c v||_T + ((1 + (1 + R^2 c/k)^{1/2}) / (2 c))^{1/2} sum_e a_e.

What the exact mesh adds to the norms (`geometry.exact_mesh`) is counted with the rounding. On a triangle
with the `distortion` eps it is eps |q| and eps |div q|, and at edges eps k |grad v|, too. At the boundary it
is also what the sides' `stretch` changes of the flow through an edge, so that q.n on the exact boundary is
what it is on this one (Proposition S14).
"""

from __future__ import annotations

import math

import numpy as np

from unilateral.arrays import Array, Index, row_blocks
from unilateral.bounds.boundary_flux import GivenEdgeFlux
from unilateral.bounds.equilibrated_flux import triangle_inflows
from unilateral.bounds.residual_norm import UNDERFLOW, ResidualParts
from unilateral.bounds.source import Source
from unilateral.fem.form import Form
from unilateral.fem.p2 import BoundaryLayer, gradients_at_nodes, linear_square_norms, quadratic_square_norms
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.refinement import CYCLIC_CORNERS
from unilateral.norms.oscillation import value_constants

SUM_ROUNDING = 2.0**-45
"""The rounding of a sum, over its terms' sizes: 128 units in the last place, for some 20 operations each."""


def misfit(mesh: Mesh, u_h: Array, q: Array, triangles: Index | slice, k: float = 1.0) -> Array:
    """k grad u_h - q at the nodes of triangles, (m, 3, 2)."""
    node = mesh.triangles[triangles].T
    return misfit_at_nodes(
        mesh, node, k * u_h.take(node), triangle_inflows(mesh, q, triangles), mesh.areas[triangles]
    ).transpose(2, 1, 0)


def misfit_at_nodes(mesh: Mesh, node: Index, u: Array, inflows: tuple[Array, Array], area: Array) -> Array:
    """grad u - q at the nodes of triangles, (2, 3, m), from u (3, m) at the nodes and `triangle_inflows`.

    With e_i the edge opposite to node i as a vector anticlockwise, and e_i' that turned to the left,

        2 |T| grad u = sum_i u_i e_i',     - 2 |T| q(x_i) = first_k e_j - last_j e_k,

    for at x_i the edge e_k begins and e_j ends, and q.n on these two is known from the inflows there.
    """
    first, last = inflows
    e_x, e_y = _edge_vectors(mesh, node)
    field = np.empty((2, *u.shape), dtype=u.dtype)
    for values, e, sign, turned in ((field[0], e_x, -1, e_y), (field[1], e_y, 1, e_x)):
        slope = sign * (u[0] * turned[0] + u[1] * turned[1] + u[2] * turned[2])
        for i, j, k in CYCLIC_CORNERS:
            np.add(slope, e[j] * first[k] - e[k] * last[j], out=values[i])
    field *= 0.5 / area
    return field


def _edge_vectors(mesh: Mesh, node: Index) -> tuple[list[Array], list[Array]]:
    """x and y of the edges opposite to each of the nodes (3, m) of triangles, anticlockwise; (m,) each."""
    points = mesh.points.ravel()
    x = points.take(2 * node)
    y = points.take(2 * node + 1)
    return [x[k] - x[j] for _, j, k in CYCLIC_CORNERS], [y[k] - y[j] for _, j, k in CYCLIC_CORNERS]


def residual_parts(
    source: Source, given_flux: GivenEdgeFlux, u_h: Array, q: Array, form: Form
) -> ResidualParts:
    """The parts of the residual of u_h (n,) in V_h."""
    mesh = source.mesh
    # s' is not stored where no triangle needs it
    s_prime = np.broadcast_to(math.inf, len(mesh.triangles))
    if form.c * mesh.diameter**2 > form.k:
        s_prime = s_prime.copy()
    # one array for the stretched divergence and then `remainder`, which takes its place block by block
    stretched = stretched_divergence(mesh, q)
    residual = ResidualParts(
        mesh,
        form,
        misfit=np.empty_like(mesh.areas),
        oscillation=np.empty_like(mesh.areas),
        mean=np.empty_like(mesh.areas),
        remainder=stretched,
        s_prime=s_prime,
    )
    for block in row_blocks(len(mesh.triangles)):
        _fill_residual(residual, block, source, q, stretched[block], u_h.take(mesh.triangles[block].T))
    add_given_flux_remainder(residual, given_flux)
    return residual


def add_lift_to_residual(
    residual: ResidualParts,
    source: Source,
    given_flux: GivenEdgeFlux,
    u_h: Array,
    q: Array,
    layer: BoundaryLayer,
    hats: Array,
    bubbles: Array,
) -> None:
    """Make the parts for u_h those for u_h + y; y has these coefficients (m, 3) on the layer's triangles.

    There s' becomes infinite, and all parts are written anew: what is given on free sides is added again.
    """
    v = u_h.take(residual.mesh.triangles[layer.triangles].T) + hats.T
    stretched = stretched_divergence(residual.mesh, q)[layer.triangles]
    _fill_residual(residual, layer.triangles, source, q, stretched, v, layer.hat_gradients, bubbles)
    add_given_flux_remainder(residual, given_flux)


def _fill_residual(
    residual: ResidualParts,
    triangles: slice | Index,
    source: Source,
    q: Array,
    stretch_allowance: Array,
    v: Array,
    hat_gradients: Array | None = None,
    bubbles: Array | None = None,
) -> None:
    """Put in the parts on some triangles, but for rho of `boundary_flux`.

    v has the values (3, m) at their nodes. It may have `bubbles` (m, 3), which takes the hats'
    `hat_gradients`. The `stretch_allowance` (m,) is their `stretched_divergence`.
    """
    mesh = residual.mesh
    form = residual.form
    area = mesh.areas[triangles]
    inflows = triangle_inflows(mesh, q, triangles)
    field = misfit_at_nodes(mesh, mesh.triangles[triangles].T, form.k * v, inflows, area)
    v_size = _max_rows(np.abs(v))
    if bubbles is not None and hat_gradients is not None:
        field += form.k * gradients_at_nodes(hat_gradients, 0 * bubbles, bubbles).transpose(2, 1, 0)
        v_size = v_size + np.abs(bubbles).sum(axis=1)
    misfit_allowance, rho_allowance = rounding_allowances(
        mesh, triangles, v_size, source.f_h[triangles].T, inflows, form, stretch_allowance
    )

    # m, o, r, E of `residual_norm`; sqrt(|T|) times a bound on a function bounds its norm
    div_q = -0.5 * (_sum_rows(inflows[0]) + _sum_rows(inflows[1])) / area
    mean, mean_free = _split_source(source, triangles, v, bubbles, form.c)
    length = np.sqrt(area)
    residual.misfit[triangles] = (
        np.sqrt(linear_square_norms(area, field.transpose(2, 1, 0))) + length * misfit_allowance
    )
    residual.oscillation[triangles] = mean_free + source.jumps[triangles]
    residual.mean[triangles] = length * np.abs(mean + div_q)
    residual.remainder[triangles] = source.remainder[triangles] + length * rho_allowance

    # s' is for linear v, and smaller than s only where T is larger than (k/c)^{1/2}
    thick = np.flatnonzero(form.c * mesh.longest_edges[triangles] ** 2 > form.k)
    if thick.size and bubbles is not None:
        residual.s_prime[triangles] = math.inf
    elif thick.size:
        rows = np.arange(len(residual.misfit))[triangles][thick]
        source_norm = (
            np.sqrt(mean_free**2 + area * mean**2) + source.jumps[triangles] + residual.remainder[triangles]
        )
        residual.s_prime[rows] = bound_by_parts(
            mesh, rows, field[..., thick], source_norm[thick], misfit_allowance[thick], form
        )


def _split_source(
    source: Source, triangles: slice | Index, v: Array, bubbles: Array | None, c: float
) -> tuple[Array, Array]:
    """The mean of f_h - c v on triangles, (m,), and the norm (m,) of p - c v less that; v as above."""
    area = source.mesh.areas[triangles]
    f_h = source.f_h[triangles].T
    g = f_h - c * v
    if bubbles is None:
        linear_squares = area / 36 * ((g[1] - g[0]) ** 2 + (g[2] - g[1]) ** 2 + (g[0] - g[2]) ** 2)
        # p - f_h is orthogonal to a linear f_h - c v
        return _sum_rows(g) / 3, np.sqrt(linear_squares + source.oscillation[triangles] ** 2)
    mean = (_sum_rows(g) - c * bubbles.sum(axis=1)) / 3
    g_squares = quadratic_square_norms(area, (g - mean).T, -c * bubbles)
    return mean, np.sqrt(g_squares) + source.oscillation[triangles]


def bound_by_parts(
    mesh: Mesh, triangles: Index, misfit: Array, source_norm: Array, misfit_allowance: Array, form: Form
) -> Array:
    """The bound s' (m,) on each of some triangles, which integrates by parts; for c > 0.

    The `misfit` k grad v - q has these values (2, 3, m) at the nodes, up to `misfit_allowance` (m,);
    `source_norm` (m,) are bounds on ||f - c v||_T.
    """
    # the exact mesh changes grad v, too: by eps k |grad v|, and k |grad v| is at most |q - k grad v| + |q|;
    # eps |q| is in `misfit_allowance`, which therefore counts twice
    allowance = 2 * misfit_allowance + mesh.distortion[triangles] * _max_rows(np.hypot(misfit[0], misfit[1]))
    corners = mesh.points[mesh.triangles[triangles]].transpose(2, 1, 0)
    # a_e, x_0, R and s' of the module's docstring
    a = _scale_normal_misfits(corners, misfit, allowance, mesh.areas[triangles])
    total = _sum_rows(a)
    x_0 = (a * corners).sum(axis=1) / total
    R = _max_rows(np.hypot(*(corners - x_0[:, None])))
    constant = np.sqrt((1 + np.sqrt(1 + R**2 * (form.c / form.k))) / (2 * form.c))
    return np.asarray(source_norm / math.sqrt(form.c) + constant * total)


def _scale_normal_misfits(corners: Array, misfit: Array, allowance: Array, area: Array) -> Array:
    """a_e = (|e|/|T|)^{1/2} ||(q - k grad v).n||_e for the edges e opposite to the nodes, (3, m).

    The triangles have the `corners` (2, 3, m), and k grad v - q these values (2, 3, m) at them, up to the
    `allowance` (m,).
    """
    a = np.empty((3, len(area)))
    for i, j, k in CYCLIC_CORNERS:
        x, y = corners[:, k] - corners[:, j]
        length = np.hypot(x, y)
        # the integrand is the square of a linear function
        start = (misfit[0, j] * y - misfit[1, j] * x) / length
        end = (misfit[0, k] * y - misfit[1, k] * x) / length
        norm = np.sqrt(length / 3 * (start**2 + start * end + end**2)) + np.sqrt(length) * allowance
        a[i] = np.sqrt(length / area) * norm
    return a


def rounding_allowances(
    mesh: Mesh,
    triangles: slice | Index,
    v_size: Array,
    f_h: Array,
    inflows: tuple[Array, Array],
    form: Form,
    stretch_allowance: Array,
) -> tuple[Array, Array]:
    """Bounds (m,) on what rounding and the exact mesh add to |k grad v - q| and to |f_h + div q - c v|.

    They are at least UNDERFLOW, below which squares may be 0. On these triangles v is at most `v_size` (m,)
    in its coefficients, f_h has the values (3, m) at nodes, and q the `triangle_inflows` there.
    """
    area = mesh.areas[triangles]
    longest = mesh.longest_edges[triangles]
    distortion = mesh.distortion[triangles]
    inverse_area = 1 / area
    flow = np.abs(_sum_rows(inflows[0]) + _sum_rows(inflows[1]))
    first = np.abs(inflows[0])
    last = np.abs(inflows[1])
    largest_flow = _max_rows([first[k] + last[j] for _, j, k in CYCLIC_CORNERS])
    flows_in = _sum_rows(first) + _sum_rows(last)
    # |grad v| is at most longest / |T| times the largest |v|, and |q| half of that times flows at a node
    gradient_factor = longest * inverse_area
    field = gradient_factor * (SUM_ROUNDING * (form.k * v_size + flows_in) + 0.5 * distortion * largest_flow)
    rho = SUM_ROUNDING * (form.c * v_size + _max_rows(np.abs(f_h)) + flows_in * inverse_area)
    rho += 0.5 * distortion * flow * inverse_area + stretch_allowance
    return field + longest * stretch_allowance + UNDERFLOW, rho + UNDERFLOW


def stretched_divergence(mesh: Mesh, q: Array) -> Array:
    """A bound on the divergence of the flux that the stretch of the sides adds to q, on each triangle, (m,).

    |q_T| is at most that times the longest edge.
    """
    triangles = mesh.boundary_triangles
    divergence = np.zeros(len(mesh.triangles))
    flow, tilt = q[:, mesh.triangulation.boundary_edges]
    flow = mesh.polygon.stretch[mesh.side] * (np.abs(flow + tilt) + np.abs(flow - tilt))
    np.add.at(divergence, triangles, 0.5 * flow / mesh.areas[triangles])
    return divergence


def add_given_flux_remainder(residual: ResidualParts, given_flux: GivenEdgeFlux) -> None:
    """Put in rho, which is not known of the flux that is given on free sides, on the triangles there."""
    mesh = residual.mesh
    form = residual.form
    triangles = mesh.boundary_triangles
    np.add.at(residual.misfit, triangles, given_flux.gradient_coefficients(mesh))
    np.add.at(residual.remainder, triangles, given_flux.value_coefficients(mesh))
    if form.c and residual.s_prime.flags.writeable:
        # s' bounds the whole of R on T, so ||z||_e is bounded by the energy norm there
        value_factors = np.sqrt(value_constants(mesh, form))
        np.add.at(residual.s_prime, triangles, value_factors * given_flux.remainder_norms)


def _sum_rows(rows: Array) -> Array:
    """The sum (m,) of three rows; this is faster than a reduction."""
    return np.asarray(rows[0] + rows[1] + rows[2])


def _max_rows(rows: Array | list[Array]) -> Array:
    return np.asarray(np.maximum(np.maximum(rows[0], rows[1]), rows[2]))
