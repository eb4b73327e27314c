"""Each term of the cheap bound, made so large that nothing else counts; and its parts by hand."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import bound_arguments

import unilateral as ul
from unilateral.bounds import flux_residuals, local_bounds
from unilateral.bounds.equilibrated_flux import equilibrated
from unilateral.bounds.feasible import Lifting, Missing
from unilateral.bounds.flux_residuals import SUMS, defects, underflow
from unilateral.bounds.source import Source, _projected, poincare
from unilateral.bounds.source_pieces import TrianglePieces
from unilateral.fem.form import Form
from unilateral.fem.p2 import layer
from unilateral.geometry import mesh as meshes
from unilateral.geometry.polygon import Polygon, named, square
from unilateral.geometry.structured import structured

LARGE = 1e6
"""The other terms are below 1."""
NEAR = 1 + 1e-5


@pytest.fixture(scope="module", params=["clamped", "with a reaction"])
def arguments(request):
    """Of `local_bound`, with no contact."""
    sides = {"c": 0, "u": {3: 0}} if request.param == "clamped" else {}
    g = [None, -1, None, None if sides else -1]
    return bound_arguments(ul.solve(ul.Problem(square(), -1, g, [0, 2], **sides), h=1 / 4, H=1 / 2).solved)


def missing(monkeypatch, **parts):
    """`Missing` has other numbers on the first boundary edge."""
    own = Lifting.lifted

    def lifted(self, nodal, bubbles):
        *values, short = own(self, nodal, bubbles)
        first = np.arange(len(nodal)) == 0
        return *values, short._replace(**{k: np.where(first, v, 0.0) for k, v in parts.items()})

    monkeypatch.setattr(Lifting, "lifted", lifted)


def without_eta(monkeypatch):
    """As if q were far from grad v, so that the other bound on lambda is the smaller one."""
    huge = LARGE**4
    monkeypatch.setattr(local_bounds, "_of_feasible", lambda *of: np.full(len(of[3]), huge))


def rounded(monkeypatch):
    own = local_bounds.defects
    monkeypatch.setattr(local_bounds, "defects", lambda *of: (*own(*of)[:2], LARGE))
    monkeypatch.setattr(
        local_bounds, "of_divergence", lambda form, areas, residual, *_, **__: (0.0, residual)
    )


def test_rounding_counts_once_for_both_errors(arguments, monkeypatch):
    rounded(monkeypatch)
    found = local_bounds.local_bound(*arguments)
    assert LARGE * (1 + 0.9 * SUMS) <= found.u <= LARGE * NEAR
    assert LARGE <= found.lambda_ <= LARGE * NEAR


def test_the_extension_counts_once_for_u_and_for_lambda(arguments, monkeypatch):
    """X^2 <= R + D^2 with D = ||w||_1, and Y <= eta, the norm of v - q."""
    missing(monkeypatch, squares=LARGE**2)
    found = local_bounds.local_bound(*arguments)
    assert LARGE * (1 + 0.9 * SUMS) <= found.u <= LARGE * NEAR
    assert LARGE <= found.lambda_ <= LARGE * NEAR


def test_without_eta_the_extension_counts_twice_for_lambda(arguments, monkeypatch):
    """Y <= D + (R + D^2)^(1/2)."""
    without_eta(monkeypatch)
    missing(monkeypatch, squares=LARGE**2)
    assert 2 * LARGE <= local_bounds.local_bound(*arguments).lambda_ <= 2 * LARGE * NEAR


def test_what_is_added_for_the_doubt_counts_by_its_norm(arguments, monkeypatch):
    monkeypatch.setattr(
        Lifting, "added", lambda self, short: np.append(np.zeros(len(self.of.triangles) - 1), LARGE**2)
    )
    found = local_bounds.local_bound(*arguments)
    assert LARGE <= found.u <= LARGE * NEAR
    assert LARGE <= found.lambda_ <= LARGE * NEAR


def test_the_slack_counts_twice_under_the_root(arguments, monkeypatch):
    """In R, and in the square of eta."""
    missing(monkeypatch, slack=LARGE**2)
    found = local_bounds.local_bound(*arguments)
    assert math.sqrt(2) * LARGE <= found.u <= math.sqrt(2) * LARGE * NEAR
    assert math.sqrt(2) * LARGE <= found.lambda_ <= math.sqrt(2) * LARGE * NEAR


def test_what_the_flux_leaves_of_lambda_counts_for_lambda_alone(arguments, monkeypatch):
    own = local_bounds.edge_flux
    monkeypatch.setattr(local_bounds, "edge_flux", lambda *of: own(*of)._replace(rest=np.full(16, LARGE**2)))
    found = local_bounds.local_bound(*arguments)
    assert found.u < 1
    data, cells, _, lambda_H, _ = arguments
    flux = own(data.mesh, cells, lambda_H)._replace(rest=np.full(16, LARGE**2))
    assert found.lambda_ >= flux.distance(data.mesh)


def test_what_divergence_misses_counts_beside_clamped_sides(arguments, monkeypatch):
    monkeypatch.setattr(
        local_bounds, "of_divergence", lambda form, areas, residual, *_, **__: (LARGE, 0 * residual)
    )
    found = local_bounds.local_bound(*arguments)
    assert LARGE <= found.u <= LARGE * NEAR
    assert LARGE <= found.lambda_ <= LARGE * NEAR


def test_what_squares_that_vanish_hide_is_added(arguments, monkeypatch):
    monkeypatch.setattr(local_bounds, "underflow", lambda *of: LARGE)
    assert LARGE <= local_bounds.local_bound(*arguments).u <= LARGE * NEAR


TRIANGLES = meshes.unstructured(named("lshape"), 0.5)
VALUES = np.random.default_rng(3).standard_normal(TRIANGLES.n_nodes)


@pytest.mark.parametrize(
    "form", [Form(), Form(clamped=(0,), friedrichs=0.7), Form(c=0.0, clamped=(0,), friedrichs=0.7)]
)
def test_what_f_and_u_differ_by_from_their_means_is_data(form):
    """sum (d/j)^2 ||w - mean w||_T^2, w = u_h - f_h with a reaction and f_h without, by a mass matrix."""
    f_h = np.random.default_rng(4).standard_normal((len(TRIANGLES.triangles), 3))
    zero = np.zeros(len(f_h))
    squares = local_bounds._of_data(Source(TRIANGLES, f_h, zero, zero), VALUES, form)
    w = form.c * VALUES[TRIANGLES.triangles] - f_h
    w = w - w.mean(axis=1, keepdims=True)
    mass = (np.ones((3, 3)) + np.eye(3)) / 12
    norms = TRIANGLES.areas * np.einsum("ti,ij,tj->t", w, mass, w)
    assert squares[0] == pytest.approx(poincare(TRIANGLES.longest_edges) ** 2 * norms)
    assert not squares[1:].any()


def test_parts_of_f_count_by_poincares_and_friedrichs_constants():
    """Of mean 0: d/j; of any mean: C beside clamped sides, where the norm is the sum of both, else 1."""
    mesh = structured(square(), 1)
    of = Source(mesh, np.zeros((2, 3)), oscillation=np.array([3.0, 0.0]), rest=np.array([0.0, 5.0]))
    constant = poincare(mesh.longest_edges)[0]
    clamped = of.squares(Form(c=0.0, clamped=(3,), friedrichs=0.6), more=np.array([1.0, 0.0]))
    assert clamped == pytest.approx(np.array([[(4 * constant) ** 2, 0], [0, (0.6 * 5) ** 2]]))
    assert of.distance(Form(c=0.0, clamped=(3,), friedrichs=0.6)) == pytest.approx(3 * constant + 3)
    free = of.squares(Form(), more=np.array([1.0, 0.0]))
    assert free == pytest.approx(np.array([[(4 * constant) ** 2, 25.0]]))
    assert of.distance() == pytest.approx(math.hypot(3 * constant, 5))
    both = Source(mesh, np.zeros((2, 3)), np.full(2, 3.0), np.full(2, 5.0)).squares(Form())
    assert both == pytest.approx(np.full((1, 2), (3 * constant) ** 2 + 25))


def test_what_jumps_leave_on_pieces_is_left_of_f():
    """Two pieces of triangle 0 with norms of 3 and 4 beside p = 0; integrals of 1 and 2; and squares of 9."""
    mesh = structured(square(), 1)
    whole = {"c": np.zeros((15, 1)), "corners": np.eye(3)[None], "parent": np.zeros(1, int)}
    areas = {"area": mesh.areas[:1], "outer": mesh.areas[:1]}
    pieces = [
        TrianglePieces(**whole, **areas, squares=np.array([k]), jumping=np.array([j]), integral=np.array([i]))
        for k, j, i in ((9.0, 3.0, 1.0), (7.0, 4.0, 2.0))
    ]
    found = _projected(mesh, pieces)
    assert found.oscillation == pytest.approx([5.0, 0.0])
    assert found.rest == pytest.approx([4.0 + 3 / math.sqrt(0.5), 0.0])


def test_values_count_only_with_a_reaction():
    """||v - f~ - div q||^2 for v = u_h + 1 where the residual is 2: (1 + 2)^2 times the area."""
    mesh = structured(square(), 1)
    of, u_h, q = layer(mesh), np.zeros(4), np.zeros((2, 5))
    hats, bubbles = np.ones((len(of.triangles), 3)), np.zeros((len(of.triangles), 3))
    inside, residual = np.zeros(2), np.full(2, 2.0)
    for reaction, expected in ((1.0, 9 * 0.5), (0.0, 0.0)):
        found = local_bounds._of_feasible(of, u_h, q, inside, reaction, residual, (hats, bubbles))
        assert found == pytest.approx(np.full(2, expected), abs=1e-12)


def test_squares_that_underflow_are_allowed_for():
    """Fewer than 2e10 of them, each off by 2^-1074; divided by areas they are off by more."""
    lost = 2e10 * 2.0**-1074
    assert lost <= flux_residuals.UNDERFLOW**2
    assert lost <= flux_residuals.DIVIDED**2
    small = structured(Polygon(1e-6 * square().vertices, "small"), 1e-6)
    assert underflow(small) >= math.sqrt(2e10) * 2.0**-537 / math.sqrt(0.5e-12)
    form = Form(c=0.0, clamped=(3,), friedrichs=3.0)
    assert underflow(small, form) / underflow(small) == pytest.approx(math.hypot(1, 3))


def constant_flux(mesh):
    """(2, E) q = (1, 0), and the source of nothing."""
    source = SimpleNamespace(mesh=mesh, moments=np.zeros((len(mesh.triangles), 3)).__getitem__)
    normal = np.repeat(mesh.polygon.normals[mesh.side, :1], 2, axis=1)
    return equilibrated(mesh, mesh.points[:, 0], source.moments, normal, 0.0), source


def test_on_the_exact_mesh_a_flux_is_larger_by_the_distortion():
    """eps |q|, with |q| = 1 on the unit square, whose area is 1."""
    mesh = structured(square(), 1 / 4)
    q, source = constant_flux(mesh)
    mesh.__dict__["distortion"] = np.full(len(mesh.triangles), 1e-3)
    found = defects(source, mesh.points[:, 0], q, 0.0)[2]
    assert 1e-3 <= found <= 10 * 1e-3


def test_without_a_reaction_u_is_no_part_of_the_residual():
    """q = (1, 0) and f = 0: -div q = 0, and u_h - div q is x, with its mean on each triangle."""
    mesh = structured(square(), 1 / 4)
    q, source = constant_flux(mesh)
    x = mesh.points[:, 0]
    for reaction, expected in ((0.0, 0 * mesh.areas), (1.0, x[mesh.triangles].mean(axis=1))):
        squares, residual, _ = defects(source, x, q, reaction)
        assert np.abs(squares).max() < 1e-12
        assert residual == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("length", [1.0, 1e-3])
def test_on_the_exact_mesh_flows_are_larger_by_the_stretch(length, monkeypatch):
    """q_T of Raviart and Thomas with the flow F at an edge: |div q_T| = F/|T|, |q_T| <= F d / (2 |T|)."""
    mesh = structured(Polygon(length * square().vertices, "scaled"), length)
    monkeypatch.setattr(Polygon, "stretch", property(lambda self: np.array([0, 1e-3, 0, 0])))
    q, _ = constant_flux(mesh)
    found = flux_residuals._stretched(mesh, q)
    flow, area, d = 1e-3 * length, length**2 / 2, math.sqrt(2) * length
    (right,) = mesh.boundary_triangles[mesh.side == 1]
    assert flow / area + flow * d / (2 * area) <= found[right] <= 2 * (flow / area) * (1 + d)
    assert found.sum() == found[right]


@pytest.mark.parametrize("seed", range(3))
def test_any_values_that_may_be_added_at_clamped_nodes_are_in_the_norm(seed):
    """Of either sign, beside those that are added: on every triangle of the layer."""
    rng, mesh = np.random.default_rng(seed), TRIANGLES
    of, nb = layer(mesh), len(mesh.boundary)
    chosen = rng.random(nb) < 0.5
    added, either = (np.where(of_nodes, rng.random(nb), 0.0) for of_nodes in (~chosen, chosen))
    short = Missing(np.zeros(nb), np.zeros(nb), added, either)
    bound = Lifting(of, None, None, None).added(short)
    for _ in range(20):
        values = added + either * rng.choice([-1.0, 1.0, 0.3], nb)
        assert np.all(of.norms(*of.function(values, np.zeros(nb))) <= bound * (1 + 1e-12))
