"""Adaptive P2 beside this project: its parts by hand, and its rate."""

from __future__ import annotations

import itertools
import json

import numpy as np
import pytest
from conftest import ROOT
from skfem import Basis, ElementTriP2, MeshTri

from benchmarks import numbers as documented
from benchmarks import precision
from unilateral.geometry.polygon import find_polygon
from unilateral.problems import case as cases


@pytest.fixture(scope="module")
def natural():
    return cases.load_solution("natural", find_polygon("square"))


@pytest.fixture
def basis():
    return Basis(MeshTri().refined(2), ElementTriP2(), intorder=precision.LOAD_ORDER)


def test_the_laplacian_of_a_quadratic_function_is_exact(basis):
    """Delta (3 x^2 + 2 x y - 7 y^2) = -8."""
    x, y = basis.doflocs
    laplacian = precision.divergence_of_gradient(basis, 3 * x**2 + 2 * x * y - 7 * y**2)
    assert laplacian == pytest.approx(np.full(basis.mesh.nelements, -8.0), abs=1e-10)


def test_the_obstacle_is_that_of_the_case_on_every_side(natural):
    """u - g is the gap that the case declares; places are given in no order."""
    rng = np.random.default_rng(0)
    side = rng.permutation(np.repeat(np.arange(4), 5))
    s = rng.random(20)
    starts = natural.polygon.vertices
    points = starts[side] + s[:, None] * (np.roll(starts, -1, axis=0) - starts)[side]
    u, _, gap = natural.trace_flux_and_gap(side, s)
    assert precision.obstacle(natural, points) == pytest.approx(u - gap, abs=1e-14)


def test_the_fewest_triangles_with_half_of_the_sum_are_marked():
    assert set(precision.mark_triangles(np.array([1.0, 5.0, 0.5, 3.0]))) == {1}
    assert set(precision.mark_triangles(np.array([1.0, 4.0, 0.5, 3.9]))) == {1, 3}


def test_p2_reaches_the_rate_of_its_degree_on_adapted_meshes(natural):
    """Nonlinear approximation by P2: error ~ N^-1. Control: a P1 method would have N^-1/2."""
    meshes = list(itertools.islice(precision.measure_p2(natural), 9))
    errors = np.array([mesh.error for mesh in meshes])
    unknowns = np.array([mesh.unknowns for mesh in meshes])
    rate = -np.polyfit(np.log(unknowns[2:]), np.log(errors[2:]), 1)[0]
    assert rate > 0.9
    assert all(seconds >= 0 for seconds in np.diff([mesh.cpu_seconds for mesh in meshes]))


class Kink:
    """A case whose f is |x - 1/2|, as if it were -Delta u + u of u = |x - 1/2| on either half."""

    def value_gradient_and_source(self, points):
        value = np.abs(points[:, 0] - 0.5)
        return value, np.zeros_like(points), value


@pytest.mark.parametrize(("touches", "expected"), [(False, 1.5), (True, 1.0)])
def test_squared_residuals_of_a_kink_are_those_by_hand(basis, touches, expected):
    """Edges have the length 1/4, and du/dn jumps by 2 on four of them: 4 (1/4 * 4 * 1/4) = 1.

    On x = 0 and x = 1 du/dn is 1: 8 (1/4 * 1 * 1/4) = 1/2, which does not count in contact.
    """
    u = np.abs(basis.doflocs[0] - 0.5)
    squares = precision.squared_residuals(Kink(), basis, u, np.full(basis.N, touches))
    assert squares.sum() == pytest.approx(expected, rel=1e-12)


def make_rows():
    p2 = {"unknowns": 100, "cpu_seconds": 0.5, "error": 0.01}
    ours = {"unknowns": 5000, "cpu_seconds": 2.0, "bound": 0.0199, "error": 0.018}
    row = {"case": "natural", "accuracy": 0.02, "p2": p2, "ours": ours}
    return {"date": "today", "processor": "x", "rows": [row, {**row, "ours": {**ours, "unknowns": 300}}]}


def test_documents_have_ratios_of_unknowns_and_seconds():
    """By hand: 50 and 3 times the unknowns, 4 times the seconds."""
    numbers = documented.precision_numbers(make_rows())
    assert numbers["unknowns"] == {"least": 3, "most": 50}
    assert numbers["cpu_seconds"] == {"least": 4, "most": 4}
    first = documented.precision(make_rows()).iloc[0].tolist()
    assert first == ["`natural`", "2 %", "100", "0.5", "5 000", "2", "2 %"]


def test_what_is_committed_has_reached_each_accuracy():
    rows = json.loads((ROOT / "benchmarks/precision.json").read_text(encoding="utf-8"))["rows"]
    asked = [(name, accuracy) for name in precision.CASES for accuracy in precision.ACCURACIES]
    assert [(row["case"], row["accuracy"]) for row in rows] == asked
    for row in rows:
        assert row["p2"]["error"] <= row["accuracy"]
        assert row["ours"]["error"] <= row["ours"]["bound"] <= row["accuracy"]
