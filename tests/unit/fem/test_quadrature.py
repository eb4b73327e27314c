"""Quadrature at kinks and singular points, against closed forms and one-dimensional integrals."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from conftest import discrete, exact_errors, load
from scipy.integrate import quad

from unilateral.discrete.condensed import discretise_case, solve_condensed_problem
from unilateral.fem import quadrature
from unilateral.fem.quadrature import boundary_rule, triangle_rules
from unilateral.geometry import mesh as meshes
from unilateral.geometry import partition as partitions
from unilateral.geometry.polygon import find_polygon, square
from unilateral.geometry.structured import make_structured_mesh
from unilateral.norms.ritz import ritz_projection

NAMES = ["full_contact", "natural", "no_contact", "smooth", "thirds"]
MESHES = {
    "structured": lambda: make_structured_mesh(square(), 1 / 8),
    "gmsh": lambda: meshes.make_unstructured_mesh(square(), 0.2),
    "lshape": lambda: make_structured_mesh(find_polygon("lshape"), 1 / 4),
}
PLACES = [(name, mesh) for name in NAMES for mesh in MESHES if (name, mesh) != ("natural", "lshape")]


@cache
def mesh_of(name):
    return MESHES[name]()


def place(name, mesh):
    """The mesh, and the case on its polygon."""
    return mesh_of(mesh), load(name, mesh_of(mesh).polygon.name)


def integral(f, mesh, case, degree=8):
    return sum(rule.weight.ravel() @ f(rule.points) for rule in triangle_rules(mesh, case, degree))


@pytest.mark.parametrize(("name", "mesh"), PLACES)
def test_the_rules_cover_the_mesh_once(name, mesh):
    """Per triangle the weights sum to its area, and the points are where their coordinates say."""
    subset, case = place(name, mesh)
    covered = np.zeros(len(subset.triangles))
    for rule in triangle_rules(subset, case):
        covered += np.bincount(rule.triangle, rule.weight.sum(axis=1), len(covered))
        assert np.all(rule.barycentric > -1e-9)
        corners = subset.points[subset.triangles[rule.triangle]]
        places = (rule.barycentric @ corners).reshape(-1, 2)
        np.testing.assert_allclose(places, rule.points, rtol=0, atol=1e-14)
    np.testing.assert_allclose(covered, subset.areas, rtol=1e-9)
    assert covered.sum() == pytest.approx(subset.polygon.area, rel=1e-13)
    boundary = boundary_rule(case.polygon, subset.s, case.singular_points())
    lengths = boundary.integrate(np.ones_like(boundary.s), len(subset.boundary))
    np.testing.assert_allclose(lengths, np.diff(subset.s), rtol=1e-12)


def moment(polygon, a, b):
    """Integral of x^a y^b over the square (0,1)^2, or over the three squares of the L."""
    unit = 1 / ((a + 1) * (b + 1))
    return unit if polygon == "square" else unit * (1 + (-1) ** a + (-1) ** (a + b))


@pytest.mark.parametrize(("name", "mesh"), PLACES)
def test_polynomials_are_exact(name, mesh):
    subset, case = place(name, mesh)
    a, b = np.array([(a, b) for a in range(9) for b in range(9 - a)]).T

    def products(points):
        return points[:, [0]] ** a * points[:, [1]] ** b

    computed = integral(products, subset, case)
    expected = [moment(subset.polygon.name, *powers) for powers in zip(a, b, strict=True)]
    np.testing.assert_allclose(computed, expected, rtol=1e-12, atol=1e-13)


def test_a_rule_of_too_low_degree_is_seen():
    mesh = mesh_of("structured")
    case = load("no_contact")
    assert abs(integral(lambda p: p[:, 0] ** 8, mesh, case, degree=1) - 1 / 9) > 1e-6


POINTS = {
    "a vertex": "1/2",
    "inside an edge": "1/3",
    "near a vertex": "0.125000001",
    "nearer than round-off": "0.1250000000001",
}


@pytest.fixture
def harmonic_at(case_like):
    """`natural` with its harmonic atom alone, at another point of the bottom."""
    atom = {"atom": "harmonic", "side": 0, "alpha": "1/2", "times": "3/2"}
    return lambda position: case_like("natural", u=[atom | {"at": position}], gap={"elsewhere": 1})


def power_over_square(x0, beta):
    """Integral of r^beta over (0,1)^2, r the distance from (x0, 0), in polar coordinates about that point.

    The triangle between two rays has the integral of rho^(beta+2)/(beta+2) over its angle, with rho the
    distance to the opposite side at d: d/cos, smooth, so Gauss-Kronrod gives it to 1e-14.
    """

    def fan(d, start, end):
        return quad(lambda phi: (d / math.cos(phi)) ** (beta + 2) / (beta + 2), start, end, epsabs=1e-15)[0]

    right = math.atan2(1, 1 - x0)
    top = math.atan(1 - x0)
    remaining = math.atan2(1, x0)
    return fan(1 - x0, 0, right) + fan(1, -math.atan(x0), top) + fan(x0, 0, remaining)


@pytest.mark.parametrize("beta", [-0.5, 0.5, 1.0, 1.5, 3.5])
@pytest.mark.parametrize("position", POINTS.values(), ids=POINTS)
def test_singular_powers_are_integrated_to_1e_6(harmonic_at, position, beta):
    """Degree 8 is limited by the pieces next to the singular one, where r^beta is analytic but not
    polynomial: 1e-6; eight degrees more gain the factor 3^8 of their relative distance."""
    case = harmonic_at(position)
    x0 = case.singular_points()[0].t
    exact = power_over_square(x0, beta)

    def power(points):
        return np.hypot(points[:, 0] - x0, points[:, 1]) ** beta

    for mesh in ("structured", "gmsh"):
        assert integral(power, mesh_of(mesh), case) == pytest.approx(exact, rel=1e-6)
        assert integral(power, mesh_of(mesh), case, 16) == pytest.approx(exact, rel=1e-9)


@pytest.mark.parametrize("position", POINTS.values(), ids=POINTS)
def test_the_energy_of_the_harmonic_atom_is_its_closed_form(harmonic_at, position):
    """|grad Im z^(3/2)|^2 = (9/4) r; far from the point the rule of degree 8 leaves 1e-8."""
    case = harmonic_at(position)
    energy = integral(
        lambda p: np.sum(case.value_and_gradient(p)[1] ** 2, axis=1), mesh_of("structured"), case
    )
    assert energy == pytest.approx(2.25 * power_over_square(case.singular_points()[0].t, 1.0), rel=1e-7)


def test_without_splitting_the_singularity_shows(harmonic_at, monkeypatch):
    case = harmonic_at("1/3")
    monkeypatch.setattr(quadrature, "split_triangles", unsplit)
    power_integral = integral(
        lambda p: np.hypot(p[:, 0] - 1 / 3, p[:, 1]) ** -0.5, mesh_of("structured"), case
    )
    assert abs(power_integral / power_over_square(1 / 3, -0.5) - 1) > 1e-4


def test_points_of_one_grading_share_a_rule():
    """In `violates_jjj` the generations 1, 3, 5 and 7 have 1 + 4 + 16 + 64 points where contact begins."""
    case = load("violates_jjj")
    _, _, (apart,) = quadrature.split_triangles(make_structured_mesh(square(), 1 / 8), case)
    assert len(np.unique(apart.point, axis=0)) == len(case.flux_singular_points()) == 85


def unsplit(mesh, case):
    return np.empty((0, 3, 3)), np.empty(0, dtype=np.intp), []


def test_the_integral_of_the_source_of_thirds_is_that_in_polar_coordinates():
    """In polar coordinates about its point f = c(theta) w(r), and c integrates to -2/3 times 2/3."""

    def w(r):
        q = 1 - 16 * r * r
        d_eta = -128 * r * q**3
        d2_eta = -128 * q**3 + 128 * 96 * r * r * q * q
        return r**1.5 * q**4 - 3 * math.sqrt(r) * d_eta - r**1.5 * d2_eta - math.sqrt(r) * d_eta

    exact = -4 / 9 * quad(lambda t: w(t * t) * t * t * 2 * t, 0, 0.5, epsabs=1e-15)[0]
    case = load("thirds")
    for mesh in ("structured", "gmsh"):
        assert integral(case.source, mesh_of(mesh), case) == pytest.approx(exact, abs=1e-7)
        assert integral(case.source, mesh_of(mesh), case, 14) == pytest.approx(exact, abs=1e-9)
        assert integral(case.source, mesh_of(mesh), case) != pytest.approx(1.001 * exact, abs=1e-7)


def cut_off_power(s, alpha):
    """Integral from 0 to s_+ of s^alpha (1 - 16 s^2)_+^4, term by term."""
    s = np.clip(s, 0, 0.25)
    powers = 2 * np.arange(5) + alpha + 1
    return sum(math.comb(4, j) * (-16) ** j * s**power / power for j, power in enumerate(powers))


def natural_gap(x):
    """Integral from x to 1/2 of 2 x (1/2 - x)_+^(3/2) = (1 - 2s) s^(3/2), s = 1/2 - x."""
    s = np.maximum(0.5 - x, 0)
    return s**2.5 / 2.5 - 2 * s**3.5 / 3.5


def bottom_means(case, partition, which):
    rule = boundary_rule(case.polygon, partition.points, case.singular_points())
    values = case.trace_flux_and_gap(rule.side, rule.s)[which]
    return (rule.integrate(values, partition.n_cells) / partition.lengths)[partition.side == 0]


@pytest.mark.parametrize("fraction", [0.0, 0.37, 0.05])
@pytest.mark.parametrize("H", [1 / 2, 1 / 8, 1 / 64])
def test_boundary_means_of_powers_are_their_closed_forms(H, fraction):
    """s^(1/2), s^(3/2) and the cut-off power in closed form, to the cancellation in it."""
    cells = partitions.make_shifted_partition(square(), H, fraction)
    x = cells.points[: np.searchsorted(cells.points, 1.0) + 1]
    root = bottom_means(load("natural"), cells, 1)
    np.testing.assert_allclose(root, np.diff(np.maximum(x - 0.5, 0) ** 1.5) / np.diff(x), rtol=0, atol=1e-12)
    gap = bottom_means(load("natural"), cells, 2)
    np.testing.assert_allclose(gap, -np.diff(natural_gap(x)) / np.diff(x), rtol=0, atol=1e-12)
    cut = bottom_means(load("thirds"), cells, 1)
    np.testing.assert_allclose(cut, np.diff(cut_off_power(x - 1 / 3, 0.5)) / np.diff(x), rtol=0, atol=1e-12)


def test_gauss_points_alone_miss_the_boundary_means():
    """What the grading is for: 16 Gauss points on a cell that a square root begins in are off by 1e-5."""
    x, w = np.polynomial.legendre.leggauss(16)
    t = 0.25 * (x + 1)
    plain = 0.25 * w @ np.sqrt(np.maximum(t - 1 / 3, 0))
    assert abs(plain - (1 / 6) ** 1.5 / 1.5) > 1e-5


def errors(name, n, degree):
    discrete_problem = discrete(name, n, n // 2, degree=degree)
    error_norms = exact_errors(discrete_problem, solve_condensed_problem(discrete_problem))
    return np.array([error_norms.h1, error_norms.l2])


@pytest.mark.parametrize(("n", "raised"), [(16, 12), (64, 9)])
@pytest.mark.parametrize("name", NAMES)
def test_the_errors_do_not_feel_the_degree(name, n, raised):
    """Raised by 4, both errors change by less than 1e-3; `no_contact` has lambda_H = 0 and no second one."""
    np.testing.assert_allclose(errors(name, n, None), errors(name, n, raised), rtol=1e-3, atol=1e-13)


def test_a_poor_rule_shows_in_the_errors(monkeypatch):
    """One point per triangle and no splitting."""
    good = discrete("smooth", 16, 8)
    monkeypatch.setattr(quadrature, "split_triangles", unsplit)
    ritz = ritz_projection(good.exact.ritz.case, good.spaces.condensed, degree=1)
    poor = discretise_case(good.spaces, replace(good.exact, ritz=ritz))
    poor_error = exact_errors(poor, solve_condensed_problem(poor)).h1
    assert abs(poor_error / exact_errors(good, solve_condensed_problem(good)).h1 - 1) > 1e-3


POWER = {"atom": "tensor", "side": 0, "profile": "1 + pos(t, 8/5)", "cutoff": "1/3"}


@pytest.fixture
def declare_case(case_like):
    return lambda **fields: case_like("full_contact", constants={}, **fields)


def test_boundary_means_see_a_power_at_a_vertex(declare_case):
    """t^(3/2) and t^(8/5) from the vertex on, in closed form; graded to nothing they were off by 1e-8."""
    cells = partitions.make_uniform_partition(square(), 1 / 4)
    gap = {"sides": [{"side": 0, "formula": "1 + pos(t, 3/2)"}], "elsewhere": 1}
    case = declare_case(u=[{"atom": "smooth", "formula": "0"}], gap=gap)
    assert bottom_means(case, cells, 2)[0] == pytest.approx(1 + 0.25**1.5 / 2.5, abs=1e-12)
    case = declare_case(u=[POWER], gap={"elsewhere": 0})
    assert bottom_means(case, cells, 1)[0] == pytest.approx(1 + 0.25**1.6 / 2.6, abs=1e-12)


def test_boundary_means_see_where_a_cutoff_crosses_another_side(declare_case):
    """On side 1 the flux is -(8/5) y (1 - 9 y^2)_+^4, its cutoff's end inside the second cell."""
    cells = partitions.make_uniform_partition(square(), 1 / 4)
    case = declare_case(u=[POWER], gap={"elsewhere": 0})
    rule = boundary_rule(case.polygon, cells.points, case.singular_points())
    means = rule.integrate(case.trace_flux_and_gap(rule.side, rule.s)[1], cells.n_cells)[4:6] / 0.25
    remaining = (1 - 9 * 0.25**2) ** 5  # integral of y (1 - 9 y^2)^4 from a: (1 - 9 a^2)^5 / 90
    np.testing.assert_allclose(
        means, -np.array([1 - remaining, remaining]) * 1.6 / 90 / 0.25, rtol=0, atol=1e-12
    )


@pytest.mark.parametrize(
    ("name", "alpha"), [("rough", -0.95), ("singular", -0.25), ("borderline_0.05", 0.05)]
)
def test_boundary_means_of_a_power_times_a_cutoff_are_their_closed_forms(name, alpha):
    """In tau = s^(1/20) that is no polynomial of a low degree."""
    case = load(name)
    cells = partitions.make_shifted_partition(square(), 1 / 8, 0.37)
    x = cells.points[: np.searchsorted(cells.points, 1.0) + 1]
    rule = boundary_rule(case.polygon, cells.points, case.singular_points())
    flux = case.trace_flux_and_gap(rule.side, rule.s, rule.nearest_anchor)[1]
    integrals = rule.integrate(flux, cells.n_cells)[cells.side == 0]
    np.testing.assert_allclose(integrals, np.diff(cut_off_power(x - 1 / 3, alpha)), rtol=1e-12, atol=1e-12)
