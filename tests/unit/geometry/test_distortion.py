"""The distance of meshes in memory from exact ones, against 50 digits and by triangles where it is sharp."""

from dataclasses import replace
from fractions import Fraction
from functools import partial

import numpy as np
import pytest
import sentences
from displaced import add_doubt
from mpmath import mp, mpf
from nested import coarse
from numpy.testing import assert_allclose

from unilateral.errors import InputError
from unilateral.fem.form import Form
from unilateral.fem.p1 import energy_norm
from unilateral.formulas.taylor import EPS
from unilateral.geometry import exact_mesh
from unilateral.geometry.mesh import make_unstructured_mesh, refine_uniformly
from unilateral.geometry.plane import longest_edges, signed_areas
from unilateral.geometry.polygon import Polygon, square
from unilateral.norms.oscillation import trace_constants, value_constants

KITE = np.array([[0, 0], [1, 0.1], [0.9, 0.7], [0, 1.3]])


def directions(angle):
    """(..., 2) unit vectors."""
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def digits(numbers):
    return np.array([[mpf(float(x)) for x in row] for row in numbers], dtype=object)


@pytest.mark.parametrize("place", [0.0, 1e3, 1e6])
@pytest.mark.parametrize("push", [0.0, 1e-9, -1e-7])
def test_shifts_are_at_least_the_distances_and_hardly_more(place, push):
    """Of nodes that are pushed along their sides by a part of it; the rest is some units of its length."""
    polygon = Polygon(KITE + place)
    mesh = refine_uniformly(make_unstructured_mesh(polygon, 0.4))
    side = mesh.side
    s = mesh.s[:-1]
    places = mesh.points[mesh.boundary] + push * polygon.tangents[side]
    node_shifts = exact_mesh.boundary_node_shifts(polygon, places, side, s)
    with mp.workdps(50):
        vertices = digits(polygon.vertices)
        starts = digits([polygon.starts])[0]
        t = [(mpf(float(x)) - starts[i]) / (starts[i + 1] - starts[i]) for x, i in zip(s, side, strict=True)]
        there = vertices[side] + np.array(t)[:, None] * (np.roll(vertices, -1, axis=0) - vertices)[side]
        displaced = np.array([mp.hypot(*shift) for shift in digits(places) - there]).astype(float)
    assert np.all(node_shifts >= displaced)
    assert np.all(node_shifts <= displaced + 3e-15)


def test_distortions_are_at_least_those_of_displaced_triangles():
    """|D Phi - I| is the largest singular value, for random triangles and nodes displaced by their shifts."""
    rng = np.random.default_rng(3)
    corners = rng.uniform(0, 1, (400, 3, 2)) * [1, 10.0 ** rng.uniform(-4, 0)]
    shift = 1e-6 * rng.uniform(0, 1, (400, 3))
    shifted = shift[..., None] * directions(rng.uniform(0, 2 * np.pi, (400, 3)))
    edges = np.moveaxis(corners[:, 1:] - corners[:, :1], 1, 2)
    factor = np.moveaxis(shifted[:, 1:] - shifted[:, :1], 1, 2)
    norms = np.linalg.norm(factor @ np.linalg.inv(edges), 2, axis=(1, 2))
    points = corners.reshape(-1, 2)
    triangles = np.arange(1200).reshape(-1, 3)
    areas = np.abs(signed_areas(points, triangles))
    longest = longest_edges(points, triangles)
    distortion_bounds = exact_mesh.distortion_bounds(shift.ravel(), triangles, longest, areas)
    assert np.all(norms <= distortion_bounds)
    assert np.max(norms / distortion_bounds) > 0.7


def test_distortions_hold_the_rounding_of_areas():
    """Of needles in all directions, whose areas are differences of rounded products."""
    rng = np.random.default_rng(8)
    angle = rng.uniform(0, 2 * np.pi, 2000)
    flat = 10.0 ** rng.uniform(-8, -1, 2000)
    along = directions(angle)
    across = directions(angle + np.pi / 2)
    place = rng.uniform(-1, 1, (2000, 2))
    corners = np.stack([place, place + along, place + 0.4 * along + flat[:, None] * across], axis=1)
    points = corners.reshape(-1, 2)
    triangles = np.arange(6000).reshape(-1, 3)
    areas = signed_areas(points, triangles)
    (a, b, c) = np.moveaxis(corners, 1, 0)
    exactly = np.vectorize(Fraction, otypes=[object])
    (e, f) = exactly(b).T - exactly(a).T
    (p, q) = exactly(c).T - exactly(a).T
    displaced = np.abs(exactly(areas) / ((e * q - f * p) / 2) - 1).astype(float)
    distortion_bounds = exact_mesh.distortion_bounds(
        np.zeros(6000), triangles, longest_edges(points, triangles), areas
    )
    assert 0.01 < np.max(displaced / distortion_bounds) <= 1


def test_the_distortion_is_sharp_where_the_node_off_the_longest_edge_moves():
    """By a part of the triangle's height, across the edge: D Phi - I is that part."""
    shift = np.array([0.0, 0.0, 2e-6])
    triangle = np.array([[0, 1, 2]])
    distortion_bounds = exact_mesh.distortion_bounds(shift, triangle, np.array([2.0]), np.array([0.02]))
    assert_allclose(distortion_bounds, 2e-6 / 0.02, rtol=1e-6)


def test_vertices_and_straight_meshes_have_no_shift():
    """Coordinates of dyadic size on sides parallel to the axes are exact."""
    mesh = refine_uniformly(make_unstructured_mesh(square(), 1 / 4))
    vertices = np.isin(mesh.s[:-1], square().starts)
    assert np.all(mesh.node_shifts[mesh.boundary[vertices]] == 0)
    inside = np.setdiff1d(np.arange(mesh.n_nodes), mesh.boundary)
    assert np.all(mesh.node_shifts[inside] == 0)
    assert mesh.node_shifts.max() <= 5 * EPS


def test_stretched_sides_are_at_least_what_sums_of_lengths_lose():
    """Of many sides the sums of their lengths are rounded; some are short."""
    rng = np.random.default_rng(4)
    polygon = Polygon(directions(np.sort(rng.uniform(0, 2 * np.pi, 200))) / 3)
    with mp.workdps(50):
        vertices = digits(polygon.vertices)
        starts = digits([polygon.starts])[0]
        lengths = np.array([mp.hypot(*edge) for edge in np.roll(vertices, -1, axis=0) - vertices])
        displaced = np.abs((np.diff(starts) - lengths) / lengths).astype(float)
    assert np.all(displaced <= polygon.stretch)
    assert np.max(displaced / polygon.stretch) > 0.3


def test_sides_that_rounding_stretches_have_no_bound():
    polygon = Polygon(np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0, 1e-13]]), "cut")
    with sentences.raises(InputError):
        exact_mesh.check_distortion(polygon, np.zeros((3, 2)), np.arange(3)[None], np.zeros(1))


@pytest.mark.parametrize("way", ["apart", "anyhow"])
def test_norms_and_constants_grow_by_no_more_than_the_growth(way):
    """On a mesh all of whose nodes are moved: apart, by 1e-4 of their places, or anyhow.

    The constants are those of traces, times norms on edges, and diameters times norms on triangles.
    """
    rng = np.random.default_rng(6)
    polygon = Polygon(KITE - KITE.mean(axis=0))
    mesh = add_doubt(make_unstructured_mesh(polygon, 1.0), 1e-4)
    displaced_points = mesh.points if way == "apart" else directions(rng.uniform(0, 2 * np.pi, mesh.n_nodes))
    shifted_mesh = replace(mesh, points=mesh.points + 1e-4 * displaced_points)
    values = [rng.uniform(-1, 1, mesh.n_nodes) for _ in range(20)]
    grown = [energy_norm(shifted_mesh, v) / energy_norm(mesh, v) for v in [*values, np.ones(mesh.n_nodes)]]
    edges = np.stack([mesh.boundary, np.roll(mesh.boundary, -1)])
    for constants in (trace_constants, partial(value_constants, form=Form(1.0, 3.0))):
        old = np.sqrt(constants(mesh) * np.hypot(*np.diff(mesh.points[edges], axis=0)[0].T))
        new = np.sqrt(constants(shifted_mesh) * np.hypot(*np.diff(shifted_mesh.points[edges], axis=0)[0].T))
        grown += [*(new / old), *(old / new)]
    grown += [
        *(shifted_mesh.longest_edges * np.sqrt(shifted_mesh.areas) / mesh.longest_edges / np.sqrt(mesh.areas))
    ]
    assert 0.02 * (mesh.exact_mesh_factor - 1) < max(grown) - 1 <= mesh.exact_mesh_factor - 1


def test_the_growth_has_the_largest_of_both():
    assert 1 < coarse("square 1").exact_mesh_factor < 1 + 1e-13


def test_the_growth_is_what_the_proof_adds_up():
    """Proposition S14: 1 + 3 t + 10 t^2 for t = epsilon + kappa, at most 10^-3 each; 2 t is too little."""
    t = np.linspace(1e-9, 2 * exact_mesh.MAX_DISTORTION, 1000)
    assert np.all(1 + 3 * t + 10 * t**2 <= 1 + exact_mesh.FACTOR_PER_DISTORTION * t)
    assert exact_mesh.MAX_DISTORTION == 1e-3
