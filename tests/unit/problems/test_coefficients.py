"""k and c: the same problem in other units has the same solution in these, and a known one is met."""

import re
from fractions import Fraction

import numpy as np
import pytest
import sentences
from skfem import Basis, ElementTriP1, MeshTri

import unilateral as ul
from unilateral.geometry.mesh import from_arrays, make_unstructured_mesh

SIDE = 1e-3
PLATE = [(0, 0), (SIDE, 0), (SIDE, SIDE), (0, SIDE)]
UNIT = [(0, 0), (1, 0), (1, 1), (0, 1)]
STOP = ul.Stop(tolerance=1e-12)
F = "3*x - 2 + pos(x - y, 0) + pos(x - 1/3, 1)"
G = "-x*y/4"
IN_METRES = {name: re.sub("[xy]", r"(1000*\g<0>)", text) for name, text in (("f", F), ("g", G))}


@pytest.fixture(scope="module")
def pair():
    """On the unit square, and on one of the length 1e-3 with k = 4 and c = 4e6, so that u = v / 2.

    With X = (c/k)^{1/2} x, v = k^{1/2} u solves the problem with k = c = 1, k^{1/2} f / c in place of f and
    k^{1/2} g in place of g. So f = c k^{-1/2} f' = 2e6 f', with f' and g' the formulas on the unit square.
    """
    problem = ul.Problem(UNIT, f=F, g=G)
    other_problem = ul.Problem(
        PLATE, f=f"2e6*({IN_METRES['f']})", g=f"({IN_METRES['g']})/2", k=4, c="4000000", name="plate"
    )
    mesh = make_unstructured_mesh(problem.polygon, 1 / 16)
    small = from_arrays(other_problem.polygon, SIDE * mesh.points, mesh.triangles)
    return ul.solve(problem, mesh=mesh, H=1 / 8, stop=STOP), ul.solve(
        other_problem, mesh=small, H=SIDE / 8, stop=STOP
    )


def test_u_lambda_gap_and_forces_are_the_same_in_other_units(pair):
    """u = v/2; lambda = k du/dn = 4 (1/2) 1000 dv/dN; its integral over a length in 1e-3 is twice as large.

    Exact but for rounding; control: v itself is not u.
    """
    first, second = pair
    assert second.u == pytest.approx(first.u / 2, abs=1e-12)
    assert second.multiplier == pytest.approx(2000 * first.multiplier, abs=2000 * 1e-10)
    assert second.gap == pytest.approx(first.gap / 2, abs=1e-12)
    assert second.mesh.points == pytest.approx(SIDE * first.mesh.points, abs=1e-15)
    assert (second.mesh.h, second.partition.H) == pytest.approx(
        (SIDE * first.mesh.h, SIDE * first.partition.H)
    )
    assert second.cells().end.iloc[-1] == 4 * SIDE
    for mine, theirs in zip(first.forces().sides, second.forces().sides, strict=True):
        assert theirs == pytest.approx([2 * number for number in mine], rel=1e-6)


def test_bounds_are_those_of_the_same_problem_in_other_units(pair):
    """(k |u|_1^2 + c ||u||_0^2)^{1/2} = ||v||_1, and the dual norm likewise."""
    first, second = pair
    assert second.bounds.u == pytest.approx(first.bounds.u, rel=1e-6)
    assert second.bounds.multiplier == pytest.approx(first.bounds.multiplier, rel=1e-6)
    assert second.bounds.unknown == pytest.approx(first.bounds.unknown, rel=0.01)


@pytest.mark.parametrize(("k", "c"), [(2, "3000000"), ("1/7", "100000"), (1, "50")])
def test_the_bound_is_above_the_error_of_a_known_solution_in_the_energy_norm(k, c):
    """u = 50 |x - m|^2 + x, full contact: lambda = k (100 (x - m) + e_1) . n > 0 on all sides, f follows.

    The error in the energy norm lies under the bound; a bound in another norm, such as without k, would be
    far off (the factor is the index that the cheap bound has at most on the square, 3).
    """
    m = SIDE / 2
    k_ = float(Fraction(k))
    c_ = float(c)
    u = f"50000*((x - {m})**2 + (y - {m})**2) + 10*x"
    problem = ul.Problem(PLATE, f=f"-{k}*200000 + {c}*({u})", g=u, k=k, c=c)
    solution = ul.solve(problem, h=SIDE / 16, H=SIDE / 8)
    error = energy_error(solution, m, k_, c_)
    assert error <= solution.bounds.u <= 3 * error
    exact = [k_ * SIDE * (100000 * m + 10 * n) for n in (0, 1, 0, -1)]
    for force, value in zip(solution.forces().sides, exact, strict=True):
        assert force.lower <= value <= force.upper
        assert force.value == pytest.approx(value, rel=0.02)


def energy_error(computed, m, k, c):
    """By a rule of degree 4, which is exact."""
    mesh = MeshTri(computed.mesh.points.T, computed.mesh.triangles.T)
    basis = Basis(mesh, ElementTriP1(), intorder=4)
    u_h = basis.interpolate(computed.u)
    places = np.asarray(basis.global_coordinates())
    displaced = 50000 * (places - m)
    slope = 2 * displaced + np.array([10, 0])[:, None, None] - u_h.grad
    value = (displaced * (places - m)).sum(axis=0) + 10 * places[0] - np.asarray(u_h)
    return np.sqrt(((k * (slope**2).sum(axis=0) + c * value**2) * basis.dx).sum())


def test_an_accuracy_is_relative_to_the_energy_norm():
    """The same levels as on the unit square up to gmsh's meshes; refused without c, as is said there."""
    fields = {"f": f"1e6*({IN_METRES['f']})", "g": IN_METRES["g"]}
    solution = ul.solve(ul.Problem(PLATE, **fields, c="1000000"), accuracy=0.05)
    assert solution.certified
    assert SIDE / 64 < solution.mesh.h < SIDE / 8
    with sentences.raises(ul.InputError):
        ul.solve(ul.Problem([(1e-9 * x, 1e-9 * y) for x, y in UNIT], f=1, g=0), h=1e-10, H=2e-10)


def test_structured_meshes_are_there_with_coefficients_too():
    """With h the square of 8² small ones; with an accuracy one halved uniformly: (2^k + 1)² unknowns."""
    problem = ul.Problem(UNIT, f="x - 1", g=0, k=4)
    solution = ul.solve(problem, h=1 / 8, H=1 / 4, mesh="structured")
    assert solution.mesh.n_nodes == 9**2
    solution = ul.solve(problem, accuracy=0.1, mesh="structured")
    assert solution.certified
    assert solution.mesh.n_nodes in {(2**k + 1) ** 2 for k in range(1, 8)}


def test_multigrid_has_the_levels_of_the_user_s_mesh():
    """The discrete solution is one, whatever finds it."""
    problem = ul.Problem([(0, 0), (SIDE, 0), (0, SIDE)], f="3e5*x - 100", g="-x", k=2, c="300000")
    multigrid = ul.solve(
        problem, h=SIDE / 16, H=SIDE / 8, mesh="unstructured", stop=ul.Stop(algorithm="multigrid")
    )
    uzawa = ul.solve(problem, h=SIDE / 16, H=SIDE / 8, mesh="unstructured", stop=ul.Stop(algorithm="uzawa"))
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


@pytest.mark.parametrize(("f", "g"), [("-1", "0"), ("0", "-1"), ("-1", "x*0"), ("0*x", "-1")])
@pytest.mark.parametrize("k", ["2.1e5", "1e6", "1e-6"])
@pytest.mark.parametrize("c", ["1", "1e-8"])
def test_data_of_0_are_accepted_in_all_units(f, g, k, c):
    """It is enclosed by numbers of 1e-323, which are larger in other units; and it is not refused."""
    assert ul.Problem(UNIT, f, g, k=k, c=c).polygon.n_sides == 4
