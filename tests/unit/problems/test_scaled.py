"""k and c: the same problem in other units has the same solution in these, and a known one is met."""

import re
from fractions import Fraction

import numpy as np
import pytest
import sentences
import sympy
from skfem import Basis, ElementTriP1, MeshTri

import unilateral as ul
from unilateral.bounds.source import enclosed
from unilateral.formulas.taylor import affine, basis
from unilateral.geometry.mesh import from_arrays, refine, similar, unstructured
from unilateral.geometry.polygon import Polygon
from unilateral.problems import scaled as scaled_module
from unilateral.problems.scaled import scaled

SIDE = 1e-3
PLATE = [(0, 0), (SIDE, 0), (SIDE, SIDE), (0, SIDE)]
UNIT = [(0, 0), (1, 0), (1, 1), (0, 1)]
STOP = ul.Stop(tolerance=1e-12)
F, G = "3*x - 2 + pos(x - y, 0) + pos(x - 1/3, 1)", "-x*y/4"
IN_METRES = {name: re.sub("[xy]", r"(1000*\g<0>)", text) for name, text in (("f", F), ("g", G))}


@pytest.fixture(scope="module")
def pair():
    """On the unit square, and in units in which its length is 1e-3 with k = 4 and c = 4e6, so u = v / 2.

    f = c k^{-1/2} f' = 2e6 f', with f' and g' the formulas on the unit square: see `units`.
    """
    one = ul.Problem(UNIT, f=F, g=G)
    other = ul.Problem(
        PLATE, f=f"2e6*({IN_METRES['f']})", g=f"({IN_METRES['g']})/2", k=4, c="4000000", name="plate"
    )
    mesh = unstructured(one.polygon, 1 / 16)
    small = from_arrays(other.polygon, SIDE * mesh.points, mesh.triangles)
    return ul.solve(one, mesh=mesh, H=1 / 8, stop=STOP), ul.solve(other, mesh=small, H=SIDE / 8, stop=STOP)


def test_u_lambda_gap_and_forces_are_in_the_user_s_units(pair):
    """u = v/2; lambda = k du/dn = 4 (1/2) 1000 dv/dN; its integral over a length in 1e-3 is twice as large.

    Exact but for rounding; control: v itself is not u.
    """
    one, other = pair
    assert other.u == pytest.approx(one.u / 2, abs=1e-12)
    assert other.multiplier == pytest.approx(2000 * one.multiplier, abs=2000 * 1e-10)
    assert other.gap == pytest.approx(one.gap / 2, abs=1e-12)
    assert other.mesh.points == pytest.approx(SIDE * one.mesh.points, abs=1e-15)
    assert (other.mesh.h, other.partition.H) == pytest.approx((SIDE * one.mesh.h, SIDE * one.partition.H))
    assert other.cells().end.iloc[-1] == 4 * SIDE
    for mine, theirs in zip(one.forces().sides, other.forces().sides, strict=True):
        assert theirs == pytest.approx([2 * number for number in mine], rel=1e-6)


def test_bounds_are_those_of_the_scaled_problem(pair):
    """(k |u|_1^2 + c ||u||_0^2)^{1/2} = ||v||_1, and the dual norm likewise."""
    one, other = pair
    assert other.bounds.u == pytest.approx(one.bounds.u, rel=1e-6)
    assert other.bounds.multiplier == pytest.approx(one.bounds.multiplier, rel=1e-6)
    assert other.bounds.unknown == pytest.approx(one.bounds.unknown, rel=0.01)


def test_the_data_of_the_scaled_problem_are_enclosed():
    """f' = k^{1/2} f / c, g' = k^{1/2} g and q' = c^{-1/2} q at the scaled point, by hand.

    A wrong factor is outside.
    """
    problem = ul.Problem(PLATE, f="1 + 500*x*y", g="x*1000", free_sides=[2], q="2000*x", k=9, c="1/4")
    data, length = scaled(problem), 6.0
    x, y = np.array([2e-4, 7e-4]), np.array([5e-4, 1e-4])
    point = [affine(basis(2, 3), each / length, np.zeros((2, 2)), (each / length,) * 2) for each in (x, y)]
    lower, upper = data.source.model(*point, {}).range
    expected = 12 * (1 + 500 * x * y)
    assert ((lower <= expected) & (expected <= upper)).all()
    assert upper - lower == pytest.approx(0, abs=1e-12)
    t = affine(basis(1, 3), np.array([0.25]), np.zeros((1, 1)), (np.array([0.25]),) * 2)
    lower, upper = data.obstacle_model(np.array([0]), t).range
    assert lower <= 3 * 0.25 <= upper
    assert upper - lower == pytest.approx(0, abs=1e-12)
    lower, upper = data.flux_model(np.array([2]), t).range
    assert lower <= 2 * 2 * 0.75 <= upper
    assert upper - lower == pytest.approx(0, abs=1e-12)
    assert data.enclosed_flux.range(2) == pytest.approx((0, 4), abs=1e-12)


@pytest.mark.parametrize(
    ("step", "places"),
    [
        (
            "1/16 - (x - 1/4)**2 - (y - 3/8)**2",
            [(1 / 2, 3 / 8), (1 / 4, 5 / 8), (0, 3 / 8), (2 / 5, 23 / 40)],
        ),
        ("2*x - 3*y - 1/2", [(1 / 4, 0), (1 / 2, 1 / 6), (1, 1 / 2)]),
    ],
)
@pytest.mark.parametrize(("k", "c", "length"), [(9, "1/4", 6), ("1/4", 25, 1 / 10)])
def test_a_step_is_at_the_same_curve_in_scaled_coordinates(step, places, k, c, length):
    """X = x / length, length = (k/c)^{1/2}: points on the circle, or line, by hand, are on the scaled one.

    Its inside is the same side, and distances are scaled. Control: without scaling they are not on it.
    """
    problem = ul.Problem(UNIT, f=f"pos({step}, 0)", g=0, k=k, c=c)
    (kink,), places = scaled(problem).source.jumps.values(), np.array(places)
    assert kink.level(places / length) == pytest.approx(0, abs=1e-14)
    assert np.abs(kink.level(places)).max() > 0.1
    x, y = np.random.default_rng(1).random((2, 100))
    inside = eval(step, {"x": x, "y": y}) > 0
    assert (kink.sign * kink.level(np.column_stack([x, y]) / length) > 0).tolist() == inside.tolist()
    assert 0 < inside.sum() < 100


def test_the_least_value_that_counts_is_rounded_down(monkeypatch):
    """k^{1/2} times that of u, with 40 digits. Control: the nearest number is above it for some k."""
    monkeypatch.setattr(scaled_module, "enclose_obstacle", lambda polygon, model, free, least, *_: least)
    above = 0
    for k in range(2, 40):
        problem = ul.Problem(UNIT, f="x - 1/3", g=-1, k=k)
        of = scaled(problem)
        exact = sympy.sqrt(k).n(40) * sympy.Rational(of.of.least)
        assert sympy.Rational(of.enclosed_obstacle) <= exact
        above += bool(sympy.Rational(of.of.least / of.of.units.value) > exact)
    assert above > 0


@pytest.mark.parametrize(("k", "c"), [(1, 1), (9, "1/4"), ("1/4", 16)])
def test_a_step_on_a_disc_keeps_its_place(k, c):
    """f is 1 on the disc of radius 0.3 about (0.4, 0.5): its integral and those over x and y are known.

    In the units of k and c f is k^(1/2) / c as large, and lengths over 6 or times 8. What is not known of f
    moves an integral by no more than the root of the area times its norm.
    """
    problem = ul.Problem(UNIT, f="pos(9/100 - (x - 2/5)**2 - (y - 1/2)**2, 0)", g=-1, k=k, c=c)
    data, unit = scaled(problem), problem.units.length
    mesh = similar(unstructured(problem.polygon, 1 / 8), data.polygon)
    found = enclosed(mesh, data.source)
    inside = 0.09 * np.pi / (problem.units.load * unit**2)
    off = np.sqrt(mesh.areas.sum()) * found.unknown
    assert off < 0.02 * inside
    assert found.moments().sum() == pytest.approx(inside, abs=off)
    centroid = np.einsum("ti,tid->d", found.moments(), mesh.points[mesh.triangles]) / inside
    assert centroid == pytest.approx(np.array([0.4, 0.5]) / unit, rel=0.02)


@pytest.mark.parametrize(("k", "c"), [(2, "3000000"), ("1/7", "100000"), (1, "50")])
def test_the_bound_of_a_known_solution(k, c):
    """u = 50 |x - m|^2 + x, full contact: lambda = k (100 (x - m) + e_1) . n > 0 on all sides, f follows.

    The error in the energy norm lies under the bound; a bound in another norm, such as without k, would be
    far off (the factor is the index that the cheap bound has at most on the square, 3).
    """
    m, k_, c_ = SIDE / 2, float(Fraction(k)), float(c)
    u = f"50000*((x - {m})**2 + (y - {m})**2) + 10*x"
    problem = ul.Problem(PLATE, f=f"-{k}*200000 + {c}*({u})", g=u, k=k, c=c)
    found = ul.solve(problem, h=SIDE / 16, H=SIDE / 8)
    error = energy_error(found, m, k_, c_)
    assert error <= found.bounds.u <= 3 * error
    exact = [k_ * SIDE * (100000 * m + 10 * n) for n in (0, 1, 0, -1)]
    for force, value in zip(found.forces().sides, exact, strict=True):
        assert force.lower <= value <= force.upper
        assert force.value == pytest.approx(value, rel=0.02)


def energy_error(found, m, k, c):
    """By a rule of degree 4, which is exact."""
    mesh = MeshTri(found.mesh.points.T, found.mesh.triangles.T)
    basis = Basis(mesh, ElementTriP1(), intorder=4)
    u_h, places = basis.interpolate(found.u), np.asarray(basis.global_coordinates())
    off = 50000 * (places - m)
    slope = 2 * off + np.array([10, 0])[:, None, None] - u_h.grad
    value = (off * (places - m)).sum(axis=0) + 10 * places[0] - np.asarray(u_h)
    return np.sqrt(((k * (slope**2).sum(axis=0) + c * value**2) * basis.dx).sum())


def test_an_accuracy_is_relative_to_the_energy_norm():
    """The same levels as on the unit square up to gmsh's meshes; refused without c, as is said there."""
    fields = {"f": f"1e6*({IN_METRES['f']})", "g": IN_METRES["g"]}
    found = ul.solve(ul.Problem(PLATE, **fields, c="1000000"), accuracy=0.05)
    assert found.certified
    assert SIDE / 64 < found.mesh.h < SIDE / 8
    with sentences.raises(ul.InputError):
        ul.solve(ul.Problem([(1e-9 * x, 1e-9 * y) for x, y in UNIT], f=1, g=0), h=1e-10, H=2e-10)


def test_structured_meshes_are_there_on_scaled_domains_too():
    """With h the square of 8² small ones; with an accuracy one halved uniformly: (2^k + 1)² unknowns."""
    problem = ul.Problem(UNIT, f="x - 1", g=0, k=4)
    found = ul.solve(problem, h=1 / 8, H=1 / 4, mesh="structured")
    assert found.mesh.n_nodes == 9**2
    found = ul.solve(problem, accuracy=0.1, mesh="structured")
    assert found.certified
    assert found.mesh.n_nodes in {(2**k + 1) ** 2 for k in range(1, 8)}


def test_multigrid_has_the_levels_of_the_user_s_mesh():
    """The discrete solution is one, whatever finds it."""
    problem = ul.Problem([(0, 0), (SIDE, 0), (0, SIDE)], f="3e5*x - 100", g="-x", k=2, c="300000")
    multigrid, uzawa = (
        ul.solve(problem, h=SIDE / 16, H=SIDE / 8, mesh="unstructured", stop=ul.Stop(algorithm=name))
        for name in ("multigrid", "uzawa")
    )
    assert multigrid.solved.result.algorithm == "multigrid"
    force = uzawa.forces().whole
    assert force.lower <= multigrid.forces().whole.value <= force.upper
    assert abs(multigrid.u.mean() - uzawa.u.mean()) <= 0.05 * np.ptp(uzawa.u)


def test_functions_have_coefficients_too():
    """The discrete solution of the same formulas, and a fault is told at the user's point."""
    fields = {"k": 2, "c": "300000", "polygon": PLATE}
    sizes = {"h": SIDE / 8, "H": SIDE / 4, "stop": STOP}
    formula = ul.solve(ul.Problem(f="3e5*x - 100", g="-x", **fields), **sizes)
    function = ul.solve(ul.Problem(f=lambda x, y: 3e5 * x - 100, g=lambda x, y: -x, **fields), **sizes)
    assert function.u == pytest.approx(formula.u, abs=1e-10 * np.abs(formula.u).max())
    with pytest.raises(ul.InputError, match=rf"the function is inf at \({SIDE:g}, 0\)"):
        ul.solve(ul.Problem(f=lambda x, y: np.where(x > 0.99 * SIDE, np.inf, 0.0), g=0, **fields), **sizes)


def test_idle_sides_know_c():
    """u >= inf f / c = 1/2: sides with g = 0.6 may have contact, with 0.4 they have none."""
    for g, idle in ((0.6, ()), (0.4, (0, 1, 2, 3))):
        assert ul.Problem(UNIT, f=1, g=g, c=2).idle_sides() == idle


def test_similar_meshes_keep_their_levels_and_ends():
    """Nodes and arc lengths times the factor; both ways are the identity up to rounding."""
    one = Polygon(np.array([(0, 0), (3, 0), (1, 2)], dtype=float))
    other = Polygon(one.vertices * 1e-3)
    mesh = refine(unstructured(one, 1.0))
    small = similar(mesh, other)
    assert small.halvings == mesh.halvings == 1
    assert small.coarse.points == pytest.approx(1e-3 * mesh.coarse.points, abs=1e-17)
    assert np.isin(other.starts, small.s).all()
    assert similar(small, one).s == pytest.approx(mesh.s, rel=1e-14)


@pytest.mark.parametrize(("f", "g"), [("-1", "0"), ("0", "-1"), ("-1", "x*0"), ("0*x", "-1")])
@pytest.mark.parametrize("k", ["2.1e5", "1e6", "1e-6"])
@pytest.mark.parametrize("c", ["1", "1e-8"])
def test_0_is_0_in_all_units(f, g, k, c):
    """It is enclosed by numbers of 1e-323, which are larger in other units; and it is not refused."""
    assert ul.Problem(UNIT, f, g, k=k, c=c).polygon.n_sides == 4
