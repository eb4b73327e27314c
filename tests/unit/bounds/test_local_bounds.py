"""Each term of the cheap bound, made so large that nothing else counts; and its parts by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from conftest import bound_arguments

import unilateral as ul
from unilateral.bounds import feasible, local_bounds, residual_norm
from unilateral.bounds.feasible import Lifting, Shortfall
from unilateral.bounds.residual_norm import SQUARES_ROUNDING, underflow_allowance
from unilateral.bounds.source import _project_pieces
from unilateral.bounds.source_pieces import TrianglePieces
from unilateral.fem.form import Form
from unilateral.fem.p2 import boundary_layer
from unilateral.geometry import mesh as meshes
from unilateral.geometry.polygon import Polygon, find_polygon, square
from unilateral.geometry.structured import make_structured_mesh

LARGE = 1e6
"""The other terms are below 1."""
NEAR = 1 + 1e-5


@pytest.fixture(scope="module", params=["clamped", "with a reaction"])
def arguments(request):
    """Of `local_bound`, with no contact."""
    sides = {"c": 0, "u": {3: 0}} if request.param == "clamped" else {}
    g = [None, -1, None, None if sides else -1]
    return bound_arguments(ul.solve(ul.Problem(square(), -1, g, [0, 2], **sides), h=1 / 4, H=1 / 2).solved)


def missing(monkeypatch, **options):
    """`Shortfall` has other numbers on the first boundary edge."""
    original = Lifting.make_feasible

    def lift_and_change(self, nodal, bubbles):
        lift = original(self, nodal, bubbles)
        first = np.arange(len(nodal)) == 0
        changed = {name: np.where(first, value, 0.0) for name, value in options.items()}
        return lift._replace(shortfall=lift.shortfall._replace(**changed))

    monkeypatch.setattr(Lifting, "make_feasible", lift_and_change)


def add_component(monkeypatch, component, name="residual_parts"):
    """A part of both functions is as large on a triangle inside.

    By `add_lift_to_residual` it is a part of v alone, on a triangle of the layer, for on others v is u_h.
    """
    original = getattr(local_bounds, name)

    def change_component(*arguments):
        residual_of_u = original(*arguments)
        residual = residual_of_u or arguments[0]
        at_boundary = np.isin(residual.mesh.triangles, residual.mesh.boundary).any(axis=1)
        getattr(residual, component)[np.argmax(at_boundary != bool(residual_of_u))] += LARGE
        return residual_of_u

    monkeypatch.setattr(local_bounds, name, change_component)


@pytest.mark.parametrize("component", ["misfit", "remainder"])
def test_a_part_of_the_residual_counts_for_both_errors(arguments, monkeypatch, component):
    """By 1 or Friedrichs' constant, which is 2 / pi on the square."""
    form = arguments[-1]
    add_component(monkeypatch, component)
    bound = local_bounds.local_bound(*arguments)
    constant = 1.0 if component == "misfit" or not form.clamped else form.value_constant
    assert LARGE * constant * (1 + 0.9 * SQUARES_ROUNDING) <= bound.u <= LARGE * constant * NEAR
    assert LARGE * constant <= bound.lambda_ <= LARGE * constant * NEAR


def test_the_extension_counts_once_for_u_and_for_lambda(arguments, monkeypatch):
    """X^2 <= R + D^2 with D = ||w||_1, and Y <= eta, the norm of v - q."""
    missing(monkeypatch, extension_squares=LARGE**2)
    bound = local_bounds.local_bound(*arguments)
    assert LARGE * (1 + 0.9 * SQUARES_ROUNDING) <= bound.u <= LARGE * NEAR
    assert LARGE <= bound.lambda_ <= LARGE * NEAR


def test_without_eta_the_extension_counts_twice_for_lambda(arguments, monkeypatch):
    """Y <= D + (R + D^2)^(1/2)."""
    add_component(monkeypatch, "misfit", "add_lift_to_residual")
    missing(monkeypatch, extension_squares=(LARGE / 4) ** 2)
    assert 2 * (LARGE / 4) <= local_bounds.local_bound(*arguments).lambda_ <= 2 * (LARGE / 4) * NEAR


def test_what_is_added_for_the_doubt_counts_by_its_norm(arguments, monkeypatch):
    monkeypatch.setattr(
        Lifting,
        "remainder_squares",
        lambda self, short: np.append(np.zeros(len(self.layer.triangles) - 1), LARGE**2),
    )
    bound = local_bounds.local_bound(*arguments)
    assert LARGE <= bound.u <= LARGE * NEAR
    assert LARGE <= bound.lambda_ <= LARGE * NEAR


def test_the_slack_counts_twice_under_the_root(arguments, monkeypatch):
    """In R, and in the square of eta."""
    missing(monkeypatch, edge_complementarity=LARGE**2)
    bound = local_bounds.local_bound(*arguments)
    assert math.sqrt(2) * LARGE <= bound.u <= math.sqrt(2) * LARGE * NEAR
    assert math.sqrt(2) * LARGE <= bound.lambda_ <= math.sqrt(2) * LARGE * NEAR


def test_what_the_flux_leaves_of_lambda_counts_for_lambda_alone(arguments, monkeypatch):
    original = local_bounds.build_normal_flux
    monkeypatch.setattr(
        local_bounds,
        "build_normal_flux",
        lambda *arguments: original(*arguments)._replace(oscillation_squares=np.full(16, LARGE**2)),
    )
    bound = local_bounds.local_bound(*arguments)
    assert bound.u < 1
    data, cells, u_h, lambda_H, form = arguments
    flux = original(data.mesh, cells, lambda_H, u_h, form)._replace(oscillation_squares=np.full(16, LARGE**2))
    assert bound.lambda_ >= flux.multiplier_distance(data.mesh, form)


def test_what_squares_that_vanish_hide_is_added(arguments, monkeypatch):
    monkeypatch.setattr(feasible, "underflow_allowance", lambda *arguments: LARGE)
    assert LARGE <= local_bounds.local_bound(*arguments).u <= LARGE * NEAR


TRIANGLES = meshes.make_unstructured_mesh(find_polygon("lshape"), 0.5)


def test_what_jumps_leave_on_pieces_is_left_of_f():
    """Two pieces of triangle 0 with norms of 3 and 4 beside p = 0; integrals of 1 and 2; and squares of 9."""
    mesh = make_structured_mesh(square(), 1)
    full = {"c": np.zeros((15, 1)), "corners": np.eye(3)[None], "parent": np.zeros(1, int)}
    areas = {"area": mesh.areas[:1], "outer_area": mesh.areas[:1]}
    pieces = [
        TrianglePieces(
            **full,
            **areas,
            remainder_squares=np.array([k]),
            jump_norm=np.array([j]),
            jump_integral=np.array([i]),
        )
        for k, j, i in ((9.0, 3.0, 1.0), (7.0, 4.0, 2.0))
    ]
    projection = _project_pieces(mesh, pieces)
    assert not projection.oscillation.any()
    assert projection.jumps == pytest.approx([5.0, 0.0])
    assert projection.remainder == pytest.approx([4.0 + 3 / math.sqrt(0.5), 0.0])


def test_squares_that_underflow_are_allowed_for():
    """Fewer than 2e10 of them, each off by 2^-1074; divided by areas they are off by more."""
    missing = 2e10 * 2.0**-1074
    assert missing <= residual_norm.UNDERFLOW**2
    assert missing <= residual_norm.QUOTIENT_UNDERFLOW**2
    small = make_structured_mesh(Polygon(1e-6 * square().vertices, "small"), 1e-6)
    minimum = math.sqrt(2e10) * 2.0**-537 / math.sqrt(0.5e-12)
    for form in (Form(), Form(4.0, 0.0, (3,), friedrichs=30.0), Form(1e-6, 9.0)):
        constants = math.sqrt(form.k), math.sqrt(form.c), 1 / math.sqrt(form.k), form.value_constant
        assert underflow_allowance(small, form) >= max(constants) * minimum


@pytest.mark.parametrize("form", [Form(), Form(2.0, 1e3), Form(3.0, 0.0)])
def test_any_values_that_may_be_added_at_clamped_nodes_are_in_the_norm(form):
    """Of either sign, beside those that are added: on every triangle of the layer."""
    rng = np.random.default_rng(0)
    mesh = TRIANGLES
    layer = boundary_layer(mesh)
    nb = len(mesh.boundary)
    chosen = rng.random(nb) < 0.5
    added = np.where(~chosen, rng.random(nb), 0.0)
    either = np.where(chosen, rng.random(nb), 0.0)
    short = Shortfall(np.zeros(nb), np.zeros(nb), added, either)
    bound = Lifting(layer, None, form, None, None).remainder_squares(short)
    for _ in range(20):
        values = added + either * rng.choice([-1.0, 1.0, 0.3], nb)
        assert np.all(layer.square_norms(form, *layer.expand(values, np.zeros(nb))) <= bound * (1 + 1e-12))
