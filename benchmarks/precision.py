"""Adaptive P2 by scikit-fem beside this project: unknowns and seconds to an accuracy of u in H^1.

Writes benchmarks/precision.json. This project certifies the accuracy by its bound. The P2 method certifies
nothing: its row is that of the first mesh whose error, measured with the known solution, is as small as that.

P2 has u >= g at its nodes on the boundary, by the primal-dual active set with sparse factors. It refines the
triangles of the largest residuals, R. Verfuerth, A Posteriori Error Estimation Techniques for Finite Element
Methods, 2013, section 1.4, with those of contact, M. Weiss, B. Wohlmuth, Math. Comp. 78 (2009) 1237-1267.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
import skfem
from scipy.sparse.linalg import splu
from skfem import Basis, ElementTriP2, FacetBasis, InteriorFacetBasis, MeshTri

import unilateral as ul
from benchmarks.__main__ import run_module
from benchmarks.peers.skfem_pyamg import energy
from benchmarks.plan import FOLDER
from unilateral.arrays import Array, Index, Mask
from unilateral.geometry.polygon import find_polygon
from unilateral.norms.ritz import h1_distance
from unilateral.problems import case as cases
from unilateral.problems.case import ExactSolution
from unilateral.system.files import replacing

CASES = ("natural", "thirds")
ACCURACIES = (0.05, 0.02, 0.01, 0.005, 0.002)
MARKED_SHARE = 0.5
"""The marked triangles have that share of the sum of all squared residuals, as few of them as possible."""
LOAD_ORDER = 6
ERROR_ORDER = 10
"""Orders of quadrature for the load and for the error."""
SIDE_ROUNDING = 1e-12
"""A point at an end of a side may lie so far beyond it, by rounding."""
MAX_SETS = 50


class Refined(NamedTuple):
    """The P2 solution on a mesh: its unknowns, the seconds up to it and its relative error in H^1."""

    unknowns: int
    cpu_seconds: float
    error: float


def measure_p2(case: ExactSolution) -> Iterator[Refined]:
    """Solutions on meshes, each refined from the one before."""
    seconds = 0.0
    mesh = MeshTri.init_tensor(np.linspace(0, 1, 3), np.linspace(0, 1, 3))
    while True:
        start = time.process_time()
        basis = Basis(mesh, ElementTriP2(), intorder=LOAD_ORDER)
        u, contact = solve_p2(case, basis)
        residuals = squared_residuals(case, basis, u, contact)
        seconds += time.process_time() - start
        yield Refined(int(basis.N), seconds, relative_error(case, mesh, u))
        start = time.process_time()
        mesh = mesh.refined(mark_triangles(residuals))
        seconds += time.process_time() - start


def solve_p2(case: ExactSolution, basis: Basis) -> tuple[Array, Mask]:
    """u (n,), and the contact nodes (n,)."""
    A = energy.assemble(basis).tocsc()
    b = load(case).assemble(basis)
    boundary = basis.get_dofs().flatten()
    g = np.full(basis.N, -np.inf)
    g[boundary] = obstacle(case, basis.doflocs[:, boundary].T)
    contact = np.zeros(basis.N, bool)
    for _ in range(MAX_SETS):
        u = np.where(contact, g, 0.0)
        free = np.flatnonzero(~contact)
        u[free] = splu(A[free][:, free]).solve((b - A @ u)[free])
        following = np.where(contact, A @ u > b, u < g)
        if np.array_equal(following, contact):
            return u, contact
        contact = following
    raise RuntimeError(f"no end of the active set after {MAX_SETS} sets")


def load(case: ExactSolution) -> Any:
    """The form (f, v)."""

    @skfem.LinearForm
    def integrand(v, w):  # type: ignore[no-untyped-def]
        return evaluate(case, w.x)[2] * v

    return integrand


def evaluate(case: ExactSolution, x: Array) -> tuple[Array, Array, Array]:
    """u, grad u and f at places x (2, t, q)."""
    points = x.reshape(2, -1).T
    u, gradient, f = case.value_gradient_and_source(points)
    return u.reshape(x.shape[1:]), gradient.T.reshape(x.shape), f.reshape(x.shape[1:])


def obstacle(case: ExactSolution, points: Array) -> Array:
    """g (k,) at points (k, 2) of the boundary."""
    polygon = case.polygon
    starts = polygon.vertices
    directions = np.roll(starts, -1, axis=0) - starts
    lengths = np.hypot(*directions.T)
    offsets = points[:, None] - starts
    along = np.einsum("ksd,sd->ks", offsets, directions) / lengths
    # The normal times the offset
    across = np.abs(np.einsum("ksd,sd->ks", offsets[..., ::-1] * (1, -1), directions) / lengths)
    outside = (along < -SIDE_ROUNDING) | (along > lengths + SIDE_ROUNDING)
    side = np.argmin(np.where(outside, np.inf, across), axis=1)
    u, _, gap = case.trace_flux_and_gap(side, along[np.arange(len(points)), side])
    return u - gap


def squared_residuals(case: ExactSolution, basis: Basis, u: Array, contact: Mask) -> Array:
    """The squared residual (t,) of each triangle."""
    # h_T^2 ||f + Delta u - u||_T^2, where h_T^2 is the area
    laplacian = divergence_of_gradient(basis, u)[:, None]
    value = np.asarray(basis.interpolate(u))
    f = evaluate(case, np.asarray(basis.global_coordinates()))[2]
    squares = basis.dx.sum(axis=1) * ((f + laplacian - value) ** 2 * basis.dx).sum(axis=1)
    # half of h_e ||[du/dn]||_e^2 for either triangle
    jump_squares, neighbours = square_jumps(basis, u)
    for triangles in neighbours:
        squares += np.bincount(triangles, 0.5 * jump_squares, len(squares))
    flux_squares, outer_triangles = square_boundary_fluxes(basis, u, contact)
    return squares + np.bincount(outer_triangles, flux_squares, len(squares))


def square_jumps(basis: Basis, u: Array) -> tuple[Array, Index]:
    """h_e ||[du/dn]||_e^2 on the inner edges, (e,), and both triangles of each, (2, e)."""
    sides = [InteriorFacetBasis(basis.mesh, ElementTriP2(), side=side) for side in (0, 1)]
    jump = sum(
        sign * (basis_e.interpolate(u).grad * sides[0].normals).sum(axis=0)
        for sign, basis_e in zip((1, -1), sides, strict=True)
    )
    squares: Array = sides[0].dx.sum(axis=1) * (jump**2 * sides[0].dx).sum(axis=1)
    return squares, basis.mesh.f2t[:, sides[0].find]


def square_boundary_fluxes(basis: Basis, u: Array, contact: Mask) -> tuple[Array, Index]:
    """h_e ||du/dn||_e^2 on the boundary edges, (e,), and the triangle of each, (e,).

    Where all nodes touch, the negative part of the flux alone counts.
    """
    mesh = basis.mesh
    outer = FacetBasis(mesh, ElementTriP2())
    flux = (outer.interpolate(u).grad * outer.normals).sum(axis=0)
    touches = contact[basis.dofs.facet_dofs[0, outer.find]]
    touches &= contact[mesh.facets[:, outer.find]].all(axis=0)
    residual = np.where(touches[:, None], np.minimum(flux, 0), flux)
    return outer.dx.sum(axis=1) * (residual**2 * outer.dx).sum(axis=1), mesh.f2t[0, outer.find]


def divergence_of_gradient(basis: Basis, u: Array) -> Array:
    """Delta u (t,) on the triangles: grad u is linear there, so its values at the corners give it."""
    corners = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    at_corners = Basis(basis.mesh, ElementTriP2(), quadrature=(corners, np.full(3, 1 / 6)))
    gradient = at_corners.interpolate(u).grad
    p = basis.mesh.p[:, basis.mesh.t]
    first = p[:, 1] - p[:, 0]
    second = p[:, 2] - p[:, 0]
    # grad lambda_1 and grad lambda_2 are the rows of the inverse of (first, second)
    determinant = first[0] * second[1] - first[1] * second[0]
    slope_1 = np.stack([second[1], -second[0]]) / determinant
    slope_2 = np.stack([-first[1], first[0]]) / determinant
    by_first = (gradient[:, :, 1] - gradient[:, :, 0]) * slope_1
    by_second = (gradient[:, :, 2] - gradient[:, :, 0]) * slope_2
    laplacian: Array = (by_first + by_second).sum(axis=0)
    return laplacian


def mark_triangles(squares: Array) -> Index:
    """The fewest triangles that have the marked share of the sum."""
    largest_first = np.argsort(-squares, kind="stable")
    sums = np.cumsum(squares[largest_first])
    return largest_first[: 1 + int(np.searchsorted(sums, MARKED_SHARE * sums[-1]))]


def relative_error(case: ExactSolution, mesh: MeshTri, u: Array) -> float:
    """||u - u_h||_1 / ||u||_1 of a P2 function."""
    basis = Basis(mesh, ElementTriP2(), intorder=ERROR_ORDER)
    v = basis.interpolate(u)
    exact, gradient, _ = evaluate(case, np.asarray(basis.global_coordinates()))
    square = (((exact - np.asarray(v)) ** 2 + ((gradient - v.grad) ** 2).sum(axis=0)) * basis.dx).sum()
    norm = ((exact**2 + (gradient**2).sum(axis=0)) * basis.dx).sum()
    return float(np.sqrt(square / norm))


def measure_ours(case: ExactSolution, accuracy: float) -> dict[str, float]:
    """The unknowns, seconds, guaranteed error and error of a solution to an accuracy."""
    start = time.process_time()
    s = ul.solve(case.problem, accuracy=accuracy)
    seconds = time.process_time() - start
    assert s.bounds
    norm = h1_distance(case, s.mesh, np.zeros_like(s.u))
    return {
        "unknowns": len(s.u),
        "cpu_seconds": seconds,
        "bound": s.bounds.relative_u,
        "error": h1_distance(case, s.mesh, s.u) / norm,
    }


def measure(name: str) -> list[dict[str, Any]]:
    """A row for each accuracy."""
    case = cases.load_solution(name, find_polygon("square"))
    measure_ours(case, max(ACCURACIES))  # so that imports do not count
    meshes = measure_p2(case)
    p2 = next(meshes)
    rows = []
    for accuracy in ACCURACIES:
        while p2.error > accuracy:
            p2 = next(meshes)
        rows.append(
            {"case": name, "accuracy": accuracy, "p2": p2._asdict(), "ours": measure_ours(case, accuracy)}
        )
        print(rows[-1], flush=True)
    return rows


def main() -> int:
    """Measures all cases, and prints and writes the rows."""
    machine = json.loads(run_module(sys.executable, "benchmarks.machine"))
    table = [row for name in CASES for row in measure(name)]
    stored = {name: machine[name] for name in ("date", "processor")} | {"rows": table}
    with replacing(FOLDER / "precision.json") as temporary:
        temporary.write_text(json.dumps(stored, indent=1) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
