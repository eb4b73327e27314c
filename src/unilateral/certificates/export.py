"""Certificates written: a function, a flux and a trace on a mesh, as `certificate/check.py` reads them.

docs/certificate.md describes the file, and the docstring of the checker has the theorem. Its hypotheses have
to hold in exact arithmetic: p.n >= 0 and v + y >= g on contact sides, and div b >= 1. So p.n is cut off at 0,
and the trace and the field b are made a little larger than rounding asks for. A file that fails in spite of
that is refused by the checker, and proves nothing that is wrong.
"""

from __future__ import annotations

import gzip
import json
import os
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from unilateral.arrays import Array, Index
from unilateral.bounds.equilibrated_flux import equilibrate_flux, triangle_inflows
from unilateral.certificates.statement import has_formulas, state_problem
from unilateral.discrete.solution import DiscreteSolution
from unilateral.fem.form import Form, decouple_nodes
from unilateral.fem.linear_systems import factorise_by_dissection
from unilateral.fem.p1 import load_vector, stiffness_and_mass
from unilateral.geometry.mesh import Mesh
from unilateral.problems.piecewise import PIECE_DEGREE, POWERS_AT_MINUS_ONE, enclose_on_intervals
from unilateral.problems.problem import Problem
from unilateral.system.files import replacing

FORMAT = "unilateral certificate 1"
CERTIFICATE_ENDINGS: dict[str, list[str]] = {".json": [], ".gz": []}
"""The endings of the names of certificates, and the optional packages that each needs: none."""
PLACE_BITS = 53
VALUE_BITS = 60
"""Coordinates and values keep so many binary places of the largest one, for the checker's integers."""
VALUE_ROUNDING = 1e-14
"""Values are rounded, and moved by rounded places, by less than this part of their size."""
THIRD_DERIVATIVE_RATIO = 1.5
"""A checker's bound on g''' is taken to be up to this many times as large as the largest |g'''|."""
DIVERGENCE_ALLOWANCE = 1e-9
"""div b is made larger than 1 by this, for its rounding."""


class JudgedFunction(NamedTuple):
    """A function `v` (n,) on a mesh, and what proves a bound on its error.

    `flux` (2, E) has the flows and tilts of p on edges, as `equilibrate_flux` gives them. `trace` (2 nb,) is
    v + y at the boundary nodes, then at the midpoints of boundary edges; it is raised to g when written.
    `field` (2, E) is that of `friedrichs_field` where c is small, and else None.
    """

    mesh: Mesh
    v: Array
    flux: Array
    trace: Array
    field: Array | None = None


def judge_solution(solved: DiscreteSolution) -> JudgedFunction:
    """The function, flux and trace on which the cheap bound of a solution rests.

    If c is 0 or small, the flux is balanced: a checker multiplies the mean of f + div p - c v on triangles by
    a constant that is less sharp than the program's. That mean is what the iteration left of the equations.
    """
    bound = solved.local_bound
    flux = solved.flux
    data = solved.data
    assert bound is not None  # the data of a user's problem are known
    assert flux is not None
    assert data is not None
    mesh = solved.mesh
    form = solved.form
    field = None
    # of k^{-1/2} C_F and c^{-1/2} a checker takes the smaller one; the field is for C_F
    if form.c * form.friedrichs**2 < form.k:
        load_means = data.source.moments().sum(axis=1) / mesh.areas
        v_means = solved.u_h[mesh.triangles].mean(axis=1)
        # the flux that is added has the divergence -surplus: f + div p - c v has the mean 0 on triangles then
        surplus = load_means - form.c * v_means + divergence(mesh, flux)
        flux = flux + poisson_flux(mesh, form.clamped, surplus)
        field = friedrichs_field(mesh, form.clamped)
    # the lift y has nodal values, and at midpoints the values of its bubbles more
    nodal, bubbles = bound.lift
    raised = solved.u_h[mesh.boundary] + nodal
    trace = np.append(raised, 0.5 * (raised + np.roll(raised, -1)) + bubbles)
    return JudgedFunction(mesh, solved.u_h, flux, trace, field)


def make_certificate(problem: Problem, judged: JudgedFunction) -> dict[str, Any]:
    """The certificate as a record of the fields of docs/certificate.md.

    Raises InputError as `state_problem`.
    """
    statement = state_problem(problem)
    mesh = judged.mesh
    polygon = mesh.polygon
    # the file has the boundary nodes first: `order` are the nodes in its order, `number` is its inverse
    inside = np.setdiff1d(np.arange(mesh.n_nodes), mesh.boundary)
    order = np.append(mesh.boundary, inside)
    number = np.argsort(order)
    # the part of its side that lies before each boundary node
    along = (mesh.s[:-1] - polygon.starts[mesh.side]) / polygon.lengths[mesh.side]
    places = np.rint(along * 2.0**PLACE_BITS) / 2.0**PLACE_BITS
    contact = np.flatnonzero(~np.isin(mesh.side, problem.free_sides + problem.clamped_sides))
    record = {
        "format": FORMAT,
        "problem": statement,
        "mesh": {
            "boundary": [places[mesh.side == side].tolist() for side in range(polygon.n_sides)],
            "inside": round_to_grid(mesh.points[inside], PLACE_BITS).tolist(),
            "triangles": number[mesh.triangles].tolist(),
        },
        "v": judged.v[order].tolist(),
        "flux": round_to_grid(edge_values(mesh, judged.flux, contact), VALUE_BITS).ravel().tolist(),
        "trace": raise_trace(problem, judged, places, contact).tolist(),
    }
    if judged.field is not None:
        record["field"] = round_to_grid(edge_values(mesh, judged.field), VALUE_BITS).ravel().tolist()
    return record


def round_to_grid(values: Array, bits: int, rounding: np.ufunc = np.rint) -> Array:
    """Values rounded to multiples of 2^-bits times a power of 2 that is above all of them."""
    exponent = int(np.frexp(np.abs(values).max(initial=0.0))[1]) - bits
    rounded = np.ldexp(rounding(np.ldexp(values, -exponent)), exponent)
    return np.asarray(rounded) + 0.0  # -0.0 becomes 0.0


def edge_values(mesh: Mesh, flux: Array, positive_edges: Index | tuple[()] = ()) -> Array:
    """p.n times the length at both ends of edges, (E, 2), in the order in which triangles mention them first.

    n points out of the triangle that mentions the edge first. On the boundary edges `positive_edges` (k,) the
    values are cut off at 0.
    """
    edges, first = np.unique(mesh.opposite_edges.ravel(), return_index=True)
    inflows = [at_end.T.ravel()[first] for at_end in triangle_inflows(mesh, flux, slice(None))]
    outflow = -np.stack(inflows, axis=1)
    cut = np.isin(edges, mesh.triangulation.boundary_edges[np.array(positive_edges, dtype=np.intp)])
    outflow[cut] = np.maximum(outflow[cut], 0.0)
    return outflow[np.argsort(first)]


def raise_trace(problem: Problem, judged: JudgedFunction, places: Array, contact: Index) -> Array:
    """v + y (2 nb,), raised to g on the boundary edges in `contact` (k,), which begin at the `places` (nb,).

    A quadratic function with the coefficients low, bend, high in Bernstein's basis is >= 0 if low, high >= 0
    and bend >= -(low high)^(1/2): v + y - g for an upper bound on g is one on each edge. On clamped sides the
    trace is u_D up to rounding, and the checker takes u_D itself.
    """
    if contact.size == 0:
        return round_to_grid(judged.trace, VALUE_BITS)
    side = judged.mesh.side
    nb = len(places)
    after = (contact + 1) % nb
    ends = np.where(side[after] == side[contact], places[after], 1.0)
    g_first, g_bend, g_last = obstacle_bounds(problem, side[contact], places[contact], ends)
    nodes, middles = np.split(judged.trace.copy(), 2)
    np.maximum.at(nodes, contact, g_first)
    np.maximum.at(nodes, after, g_last)
    first = nodes[contact]
    last = nodes[after]
    margin = VALUE_ROUNDING * (np.abs(first) + np.abs(last) + np.abs(g_bend))
    low = np.maximum(first - g_first - margin, 0.0)
    high = np.maximum(last - g_last - margin, 0.0)
    # bend = 2 (v + y at the midpoint) - (first + last) / 2 - g_bend
    middle_lower = 0.25 * (first + last) + 0.5 * (g_bend - np.sqrt(low) * np.sqrt(high)) + margin
    middles[contact] = np.maximum(middles[contact], middle_lower)
    return round_to_grid(np.append(nodes, middles), VALUE_BITS, np.ceil)


def obstacle_bounds(problem: Problem, side: Index, start: Array, end: Array) -> Array:
    """Upper bounds on g in Bernstein's basis on parts of sides, as a checker encloses g there, (3, k).

    The checker interpolates g at the ends and the midpoint of a part. If |g'''| <= M, with the variable t in
    [0, 1], the rest is at most M t (1 - t) / 12, which moves the middle coefficient by M / 24. Here g is a
    polynomial in 2 t - 1 with the coefficients c, up to a small remainder.
    """
    pieces = enclose_on_intervals(problem.obstacle_model, side, start, end)
    k = np.arange(PIECE_DEGREE + 1.0)
    # the third derivatives of (2 t - 1)^k; a checker encloses them by intervals, and so less sharply
    M = THIRD_DERIVATIVE_RATIO * 8 * (k * (k - 1) * (k - 2) * 2 ** (k - 3)) @ np.abs(pieces.c)
    first = POWERS_AT_MINUS_ONE @ pieces.c
    last = pieces.c.sum(axis=0)
    middle = pieces.c[0]
    margin = 2 * pieces.rad + VALUE_ROUNDING * np.abs(pieces.c).sum(axis=0)
    return np.stack([first, 2 * middle - 0.5 * (first + last) + M / 24 + margin, last]) + margin


def friedrichs_field(mesh: Mesh, clamped: tuple[int, ...]) -> Array:
    """A field b with div b >= 1, and b.n = 0 on sides that are not clamped, by its flows and tilts (2, E)."""
    field = poisson_flux(mesh, clamped, -np.ones(len(mesh.triangles)))
    field[1] = 0.0  # one value on each edge, with the same divergence
    # areas of the exact mesh differ by the distortion, with a second one for the rounding of places
    margin = 1 + DIVERGENCE_ALLOWANCE + 2 * float(mesh.distortion.max())
    return field * (margin / divergence(mesh, field).min())


def poisson_flux(mesh: Mesh, clamped: tuple[int, ...], f: Array) -> Array:
    """The flux of the phi with -lap phi = f, by its flows and tilts (2, E); its divergence is -f.

    f (m,) is constant on triangles. phi is 0 on the clamped sides, and the flux through all others is 0.
    """
    form = Form(c=0.0, clamped=clamped)
    fixed = form.clamped_nodes(mesh)
    moments = np.repeat((mesh.areas * f / 3)[:, None], 3, axis=1)
    stiffness, _ = stiffness_and_mass(mesh)
    phi = factorise_by_dissection(decouple_nodes(stiffness, fixed)).solve(
        np.where(fixed, 0.0, load_vector(mesh, moments))
    )
    normal = np.where(form.clamped_edges(mesh)[:, None], np.nan, np.zeros((len(mesh.boundary), 2)))
    return equilibrate_flux(mesh, phi, lambda part: moments[part], normal, form)


def divergence(mesh: Mesh, flux: Array) -> Array:
    """The divergence of a flux on each triangle, from its flows and tilts, (m,)."""
    at_first, at_last = triangle_inflows(mesh, flux, slice(None))
    # |T| div q is the flow out: the sum over the edges of -(first + last) / 2
    return np.asarray(-0.5 * (at_first + at_last).sum(axis=0) / mesh.areas)


def write_certificate(record: dict[str, Any], path: str | os.PathLike[str]) -> None:
    """Write a certificate, compressed if the name ends in .gz."""
    text = json.dumps(record, separators=(",", ":"), allow_nan=False).encode()
    with replacing(path) as temporary:
        temporary.write_bytes(gzip.compress(text, 6, mtime=0) if temporary.suffix == ".gz" else text)


def find_checker(problem: Problem) -> Path:
    """The program that checks certificates of a problem: it is installed, or in the project's folder."""
    name = "check_formulas.py" if has_formulas(state_problem(problem)) else "check.py"
    package = Path(__file__).parents[1]
    installed = package / "checker" / name
    file = installed if installed.is_file() else package.parents[1] / "certificate" / name
    return file.relative_to(Path.cwd()) if file.is_relative_to(Path.cwd()) else file
