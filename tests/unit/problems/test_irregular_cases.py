"""The cases at the limits of the hypotheses: fluxes, means and energies, and what their certificates say."""

import math
from fractions import Fraction

import numpy as np
import pytest
import sentences
from conftest import home
from conftest import load as load_on

from unilateral.errors import InputError
from unilateral.fem.quadrature import boundary_rule, triangle_rules
from unilateral.formulas.expression import rational_expression
from unilateral.geometry import partition as partitions
from unilateral.geometry.mesh import make_unstructured_mesh
from unilateral.geometry.polygon import Polygon, find_polygon, square
from unilateral.geometry.structured import make_structured_mesh
from unilateral.problems.atoms import SidePoints
from unilateral.problems.case_certificate import certify_case
from unilateral.problems.polar_atoms import make_corner_atom, make_harmonic_atom

ALPHA = {
    "borderline_0.25": 0.25,
    "borderline_0.1": 0.1,
    "borderline_0.05": 0.05,
    "violates_jj": 0.5,
    "singular": -0.25,
    "rough": -0.95,
}
ON = {"vertex": "square", "violates_j": "lshape", "reentrant": "lshape"} | dict.fromkeys(ALPHA, "square")


def load(name):
    return load_on(name, ON[name])


def polar(kind, alpha=None, vertex=2):
    """Vertex 2 of the L-shape is the re-entrant one, vertex 1 a right angle."""
    power = None if alpha is None else Fraction(alpha)
    cutoff = rational_expression(Fraction(1, 4))
    if kind == "harmonic":
        return make_harmonic_atom(square(), 0, 0.5, power, cutoff)
    return make_corner_atom(find_polygon("lshape"), vertex, kind, power, cutoff)


@pytest.mark.parametrize(
    ("atom", "lipschitz", "flux_bounded", "flux_in_L2", "in_H2"),
    [
        (polar("harmonic", "1/2"), True, True, True, True),
        (polar("harmonic", "-1/4"), False, False, True, False),
        (polar("harmonic", "-1/2"), False, False, False, False),
        (polar("free"), False, True, True, False),
        (polar("held"), True, False, True, False),
        (polar("free", vertex=1), True, True, True, True),
        (polar("transition", "-1/4"), False, False, True, False),
    ],
    ids=["1/2", "-1/4", "-1/2", "free", "held", "free at 90 degrees", "transition"],
)
def test_the_regularity_of_an_atom_follows_from_its_exponent(
    atom, lipschitz, flux_bounded, flux_in_L2, in_H2
):
    """u is like r^beta on a side or 0 there, lambda like r^(beta - 1) or 0, beta = 1 + alpha or pi/omega.

    So with beta < 1 a trace is Lipschitz, or a flux bounded, only if it vanishes on both sides.
    """
    assert atom.regularity == (in_H2, lipschitz, flux_in_L2, flux_bounded, True)


@pytest.mark.parametrize(("alpha", "refused"), [("-1/3", True), ("1/3", True), ("0", False), ("-1", True)])
def test_a_transition_needs_no_logarithm(alpha, refused):
    """At 3 pi/2 it does where sin(3/2 (1 + alpha) pi), by which it is divided, is 0."""
    if not refused:
        assert polar("transition", alpha).beta == 1
        return
    with sentences.raises(InputError):
        polar("transition", alpha)


@pytest.mark.parametrize(("displaced", "refused"), [(1e-14, False), (1e-9, True)])
def test_an_angle_is_a_fraction_of_pi_up_to_rounding(displaced, refused):
    """pi/2 - off: for a larger one an atom's flux would be about as large on a side where it has to be 0."""
    nearly = Polygon(np.array([[0, 0], [1, 0], [1, 1], [displaced, 1]]), "nearly")
    if refused:
        with sentences.raises(InputError):
            make_corner_atom(nearly, 0, "free")
    else:
        assert make_corner_atom(nearly, 0, "free").beta == 2


def test_a_linear_transition_is_bounded():
    """r cos(theta - omega), though it vanishes on one side only."""
    assert polar("transition", "0").regularity.lipschitz
    assert polar("transition", "0").regularity.flux_bounded


def test_an_atom_at_a_vertex_has_its_trace_on_a_side_of_another_length():
    """r^2 cos 2 theta at 90 degrees: -r^2 on the side before, of length 2, without flux."""
    r = np.array([0.1, 0.25])
    along = SidePoints(1 - r / 2, np.ones(2), -r / 2)
    value, flux = make_corner_atom(find_polygon("lshape"), 0, "free").trace_and_normal_flux(5, along)
    np.testing.assert_allclose(value, -(r**2), rtol=1e-14)
    np.testing.assert_allclose(flux, 0, rtol=0, atol=1e-15)


def test_polar_atoms_are_singular_at_their_centre_and_at_the_ends_of_their_cutoff():
    """Their centre, with the denominator of beta, 3/2 and 2/3, on both of its sides; their cutoff's ends."""
    singular_points = {(p.side, p.t, p.grading) for p in polar("harmonic", "1/2").singular_points()}
    assert singular_points == {(0, 1 / 2, 2), (0, 1 / 4, 1), (0, 3 / 4, 1)}
    singular_points = {(p.side, p.t, p.grading) for p in polar("held").singular_points() if p.t >= 0}
    assert singular_points == {(2, 0.0, 3), (1, 1.0, 3), (2, 1 / 4, 1)}


@pytest.mark.parametrize("displaced", [1e-17, 0.0, -0.0, -1e-17])
def test_rounding_beyond_a_side_is_on_it(displaced):
    """On the side at angle 0 the held atom is 0; taken for the angle 2 pi it would be sin(4 pi/3) r^(2/3)."""
    value, _ = polar("held").value_and_gradient(np.array([[0.1, displaced], [0.2, displaced]]))
    np.testing.assert_allclose(value, 0, rtol=0, atol=1e-15)


def cut_off_power(s, alpha, R):
    """Integral from 0 to s_+ of s^alpha (1 - (s/R)^2)_+^4, term by term."""
    s = np.clip(s, 0, R)
    terms = (math.comb(4, j) * (-1) ** j * (s / R) ** (2 * j) / (2 * j + 1 + alpha) for j in range(5))
    return s ** (1 + alpha) * sum(terms)


def means(case, cells, near=True):
    rule = boundary_rule(case.polygon, cells.points, case.singular_points())
    flux = case.trace_flux_and_gap(rule.side, rule.s, rule.nearest_anchor if near else None)[1]
    return rule.integrate(flux, cells.n_cells) / cells.lengths


@pytest.mark.parametrize("cells", [(1 / 2, 0.0), (1 / 8, 0.37), (1 / 64, 0.05), (1 / 512, 0.0)])
@pytest.mark.parametrize("name", ALPHA)
def test_cell_means_are_their_closed_forms(name, cells):
    """To 1e-11 of the largest: the closed form cancels."""
    partition = partitions.make_shifted_partition(square(), *cells)
    x = np.minimum(partition.points, 1.0)
    full = np.diff(cut_off_power(x - 1 / 3, ALPHA[name], 0.25)) / partition.lengths
    np.testing.assert_allclose(means(load(name), partition), full, rtol=0, atol=1e-11 * full.max())


def test_without_the_distance_itself_a_sixth_of_a_mean_is_lost():
    """Control: what lies nearer to the point than round-off, (1e-16)^0.05 = 0.16 of the integral."""
    with np.errstate(divide="ignore"):
        cell = means(load("rough"), partitions.make_uniform_partition(square(), 1 / 8), near=False)[2]
    exact = float(cut_off_power(np.array([3 / 8 - 1 / 3]), -0.95, 0.25)[0]) * 8
    assert not cell >= 0.95 * exact


def test_atoms_at_the_re_entrant_vertex_have_their_traces_and_fluxes():
    """r^(2/3) cos(2 theta/3) has no flux and the traces +-r^(2/3); the held one no trace and both fluxes."""
    r = np.linspace(1e-3, 0.49, 100)
    chi = (1 - 4 * r**2) ** 4
    for side, t, sign in ((2, r, 1), (1, 1 - r, -1)):
        sides = np.full(len(r), side)
        u, flux, _ = load("reentrant").trace_flux_and_gap(sides, t)
        np.testing.assert_allclose(u, sign * r ** (2 / 3) * chi, rtol=0, atol=1e-12)
        np.testing.assert_allclose(flux, 0, rtol=0, atol=1e-12)
        trace, flux, _ = load("violates_j").trace_flux_and_gap(sides, t)
        x, y = find_polygon("lshape").at(sides, t).T
        np.testing.assert_allclose(trace, ((x + 0.45) ** 2 + (y - 0.55) ** 2) / 2, rtol=0, atol=1e-12)
        smooth = 0.55 if side == 2 else 0.45  # the distance of (-.45, .55) from the side's line
        np.testing.assert_allclose(flux, smooth + 2 / 3 * r ** (-1 / 3) * chi, rtol=1e-9)


@pytest.mark.parametrize(
    ("name", "vertex", "angle", "square_distance"),
    [
        ("obtuse_0.9", 1, 0.9 * np.pi, (1.5, 0.66, 0.41)),
        ("obtuse_0.75", 2, 0.75 * np.pi, (1.5, 0.66, 0.41)),
        ("reentrant_full", 2, 1.5 * np.pi, (4, -0.45, 0.55)),
    ],
)
def test_in_full_contact_at_a_vertex_the_flux_is_that_of_the_square_alone(
    name, vertex, angle, square_distance
):
    """r^(pi/omega) cos(pi theta/omega), r and theta by complex numbers, and a square distance.

    On the two sides at the vertex lambda is that of the latter alone: the same number all along and positive.
    """
    case = load_on(name, home(name).name)
    (times, x, y) = square_distance
    polygon = case.polygon
    position = case.polygon.vertices[vertex]
    inside = triangles_inside(polygon)
    z = (inside - position) @ [1, 1j] / (polygon.tangents[vertex] @ [1, 1j])
    theta = np.angle(z) % (2 * np.pi)
    assert np.all(theta < angle)
    smooth = times * np.sum((inside - [x, y]) ** 2, axis=1)
    u = (
        np.abs(z) ** (np.pi / angle)
        * np.cos(np.pi / angle * theta)
        * polygon.lengths[vertex] ** (1 - np.pi / angle)
    )
    np.testing.assert_allclose(case.value_and_gradient(inside)[0], u + smooth, rtol=1e-12)
    for side in (vertex, vertex - 1):
        s = np.linspace(0.01, 0.99, 9) * polygon.lengths[side]
        _, flux, gap = case.trace_flux_and_gap(np.full(9, side), s)
        distance = polygon.normals[side] @ (position - [x, y])
        np.testing.assert_allclose(flux, 2 * times * distance, rtol=1e-12)
        assert not gap.any()
    known_case = certify_case(case)
    assert known_case.contact == tuple((side, 0, 1) for side in range(6))


def triangles_inside(polygon):
    """(k, 2) centroids of the triangles of a mesh."""
    mesh = make_unstructured_mesh(polygon, 1 / 5)
    return mesh.points[mesh.triangles].mean(axis=1)


def squared_gradient(case, *where):
    return np.sum(case.value_and_gradient(*where)[1] ** 2, axis=1)


def test_energies_feel_a_rounded_distance():
    """Control: for `rough` 1e-16^0.1 = 2.5 % of the energy lie nearer to the point than round-off."""
    case = load("rough")
    rules = list(triangle_rules(make_structured_mesh(square(), 1 / 12), case, 14))
    with np.errstate(all="ignore"):
        rounded = sum(
            rule.weight.ravel() @ squared_gradient(case, *(lambda rule: (rule.points,))(rule))
            for rule in rules
        )
        exact = sum(
            rule.weight.ravel() @ squared_gradient(case, *(lambda rule: (rule.origin, rule.offset))(rule))
            for rule in rules
        )
    assert not abs(rounded / exact - 1) < 0.01


def test_the_points_of_the_rule_are_those_of_its_parts():
    """s = t L + the distance, up to rounding, on every side."""
    case = load("violates_j")
    rule = boundary_rule(case.polygon, case.polygon.starts, case.singular_points())
    t, offset = rule.nearest_anchor
    np.testing.assert_allclose(t * case.polygon.lengths[rule.side] + offset, rule.s, rtol=0, atol=1e-15)


@pytest.mark.parametrize(
    "atom",
    [
        {"kind": "held", "vertex": 1},
        {"kind": "transition", "vertex": 0, "alpha": 1},
        {"kind": "held", "vertex": 5},
        {"kind": "held", "vertex": 0, "alpha": 1},
        {"kind": "transition", "vertex": 0},
        {"kind": "held"},
    ],
)
def test_bad_corners_are_refused(atom, case_like):
    odd = Polygon(np.array([[0, 0], [1, 0], [1.1, 1], [0, 1]]), "odd")
    with sentences.raises(InputError):
        case_like("full_contact", odd, polygons="any", constants={}, u=[{"atom": "corner", **atom}])


@pytest.mark.parametrize("name", ["value_and_gradient", "value_gradient_and_source"])
def test_outside_its_support_an_atom_is_not_evaluated(monkeypatch, name):
    """Of 100 x 100 places 1/8 pi lie in the half disc of radius 1/2, to 100 of its boundary's squares."""
    atom = make_harmonic_atom(square(), 0, 0.5, Fraction(1, 2), rational_expression(Fraction(1, 2)))
    calls = []

    def count_points(numbers):
        return lambda r, theta: calls.append(len(r)) or [np.ones_like(r)] * numbers

    monkeypatch.setitem(vars(atom), "_compiled_formulas", (count_points(3), count_points(4)))
    x = (np.arange(100) + 0.5) / 100
    places = np.stack(np.meshgrid(x, x), axis=-1).reshape(-1, 2)
    getattr(atom, name)(places)
    assert calls == [pytest.approx(1e4 * np.pi / 8, abs=100)]
