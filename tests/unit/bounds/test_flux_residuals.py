"""What rounding does to the sums over triangles, against numbers with eleven bits more."""

from types import SimpleNamespace

import numpy as np
import pytest
from hand_made import Manufactured, enclosed

from unilateral.bounds.equilibrated_flux import equilibrated, flows
from unilateral.bounds.flux_residuals import SUMS, defects, misfit
from unilateral.fem.p2 import linear_squares
from unilateral.geometry import mesh as meshes
from unilateral.geometry.polygon import Polygon, named, square
from unilateral.geometry.structured import structured

MORE = np.longdouble
MESHES = {
    "square": lambda: structured(square(), 1 / 16),
    "lshape": lambda: meshes.unstructured(named("lshape"), 0.1),
    "thin": lambda: meshes.unstructured(
        Polygon(np.array([[0, 0], [10, 0], [10, 1e-3], [0, 1e-3]]), "thin"), 0.05
    ),
    "far": lambda: meshes.unstructured(Polygon(square().vertices + np.array([0, 1e6]), "far"), 0.2),
}
RESERVE = 256
"""The allowance over what rounding does at random: some twenty operations may all round the same way."""


def as_if_exact(mesh):
    """The mesh with sides that go through its nodes, so that what is allowed is for rounding alone."""
    mesh.__dict__["distortion"] = np.zeros(len(mesh.triangles))
    mesh.polygon.__dict__["stretch"] = np.zeros(len(mesh.polygon.vertices))
    return mesh


def finer(mesh):
    """The same triangles, their areas with those bits."""
    points = mesh.points.astype(MORE)
    a, b, c = (points[mesh.triangles[:, i]] for i in range(3))
    (ux, uy), (vx, vy) = (b - a).T, (c - a).T
    edges = {"triangulation": mesh.triangulation, "opposite_edges": mesh.opposite_edges}
    return SimpleNamespace(points=points, triangles=mesh.triangles, areas=(ux * vy - uy * vx) / 2, **edges)


def functions(mesh):
    x = mesh.points[:, 0] - mesh.points[:, 0].min()
    return [np.random.default_rng(0).standard_normal(mesh.n_nodes), 1e6 + x, x]


def of_x(mesh):
    """q.n for q = (1, 0)."""
    return np.repeat(mesh.polygon.normals[mesh.side, :1], 2, axis=1)


def fluxes(mesh, u, moments):
    """One that has nothing to do with u, and one that cancels with it."""
    yield np.random.default_rng(1).standard_normal((2, len(mesh.triangulation.ends)))
    yield equilibrated(mesh, u, moments.__getitem__, of_x(mesh))


def shares(mesh):
    """What rounding has done to ||grad u - q|| and to u - f - div q, over what is allowed for it."""
    of = finer(mesh)
    for u in functions(mesh):
        moments = (
            mesh.areas[:, None] / 12 * (u[mesh.triangles] + u[mesh.triangles].sum(axis=1, keepdims=True))
        )
        for q in fluxes(mesh, u, moments):
            squares, residual, allowed = defects(
                SimpleNamespace(mesh=mesh, moments=moments.__getitem__), u, q
            )
            exact = linear_squares(of.areas, misfit(of, u.astype(MORE), q.astype(MORE), slice(None)))
            yield abs(np.sqrt(squares.sum()) - np.sqrt(exact.sum())) / allowed
            flow = np.sum(flows(of, q.astype(MORE), slice(None)), axis=(0, 1))
            load = moments.astype(MORE).sum(axis=1)
            divergence = u.astype(MORE)[of.triangles].sum(axis=1) / 3 + (flow / 2 - load) / of.areas
            yield np.sqrt((of.areas * (residual - divergence) ** 2).sum()) / allowed


@pytest.mark.skipif(np.finfo(MORE).nmant < 63, reason="this machine has no longer numbers")
@pytest.mark.parametrize("name", MESHES)
def test_rounding_is_far_below_its_allowance_and_not_nothing(name):
    worst = max(shares(as_if_exact(MESHES[name]())))
    assert 1e-4 < worst < 1 / RESERVE


def test_rounding_is_added():
    """u = 1e6 + x, f = u: the error of its interpolant is 0, and the bound what derivatives of it lose."""
    problem = Manufactured(square(), "1000000 + x", "1")
    mesh = structured(square(), 1 / 16)
    u_h, source = 1e6 + mesh.points[:, 0], enclosed(mesh, problem)
    q = equilibrated(mesh, u_h, source.moments, of_x(mesh))
    squares, residual, rounding = defects(source, u_h, q)
    assert 0 < np.sqrt(squares.sum() + mesh.areas @ residual**2) <= rounding < 1e-4


def test_the_rounding_of_a_root_of_a_sum():
    """Of 16 million squares, each added with half a unit of rounding: the root has half of that."""
    assert SUMS >= 16e6 * 2.0**-53 / 2
