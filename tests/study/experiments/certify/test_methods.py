"""Solutions of other methods: conditions that define them, and limits in which they agree."""

import numpy as np
import pytest
import skfem
from conftest import load

from study.experiments.certify import measure
from unilateral.geometry.polygon import square
from unilateral.geometry.structured import make_structured_mesh
from unilateral.norms.ritz import h1_distance
from unilateral.problems.case import derive_solution

P1 = skfem.ElementTriP1()
P2 = skfem.ElementTriP2()
MESH = make_structured_mesh(square(), 1 / 8)
CASES = {name: load(name) for name in ("natural", "clamped")}
QUADRATIC = {
    "title": "u = (x - 1/2)^2 + (y - 1/2)^2 in full contact, du/dn = 1",
    "polygons": "any",
    "u": [{"atom": "smooth", "formula": "(x - 1/2)**2 + (y - 1/2)**2"}],
    "gap": {"elsewhere": 0},
}


def select_constrained_nodes(nodal_problem):
    return np.isfinite(nodal_problem.g) & ~nodal_problem.fixed


def conditions(nodal_problem, x):
    """How far x >= g, r >= 0, r (x - g) = 0, and r = 0 at other unknowns fail; r = Ax - load."""
    r = nodal_problem.A @ x - nodal_problem.load
    constrained_nodes = select_constrained_nodes(nodal_problem)
    gap = x[constrained_nodes] - nodal_problem.g[constrained_nodes]
    inside = ~constrained_nodes & ~nodal_problem.fixed
    return max(
        -gap.min(),
        -r[constrained_nodes].min(),
        np.abs(r[constrained_nodes] * gap).max(),
        np.abs(r[inside]).max(),
    )


@pytest.mark.parametrize("element", [P1, P2], ids=["P1", "P2"])
@pytest.mark.parametrize("case", CASES.values(), ids=CASES)
def test_nodal_constraints_satisfy_what_defines_them(case, element):
    """The conditions of the convex problem, which has one solution. Control: x moved by 1e-6 at one node."""
    nodal_problem = measure.assemble_nodal_problem(case, MESH, element)
    x = measure.solve_nodal_problem(nodal_problem)
    assert conditions(nodal_problem, x) < 1e-12
    assert (
        0
        < np.count_nonzero(
            x[select_constrained_nodes(nodal_problem)]
            > nodal_problem.g[select_constrained_nodes(nodal_problem)]
        )
        < select_constrained_nodes(nodal_problem).sum()
    )
    shifted = x + 1e-6 * (np.arange(len(x)) == np.flatnonzero(select_constrained_nodes(nodal_problem))[3])
    assert conditions(nodal_problem, shifted) > 1e-7


def test_a_quadratic_solution_is_in_p2_and_not_in_p1():
    """u is in P2, so the discrete solution is u. P1 is of first order; its distance from u halves with h."""
    case = derive_solution(QUADRATIC, "quadratic", square(), 0)
    nodal_problem = measure.assemble_nodal_problem(case, MESH, P2)
    nodal_values = measure.solve_nodal_problem(nodal_problem)[: MESH.n_nodes]
    np.testing.assert_allclose(nodal_values, case.value_and_gradient(MESH.points)[0], atol=1e-13)
    errors = []
    for h in (1 / 8, 1 / 16):
        mesh = make_structured_mesh(square(), h)
        x = measure.solve_nodal_problem(measure.assemble_nodal_problem(case, mesh, P1))
        errors.append(h1_distance(case, mesh, x))
    assert errors[0] / errors[1] == pytest.approx(2, rel=0.02)


def test_clamped_nodes_have_the_given_values_by_every_method():
    """u = cos(pi x)/2 on top."""
    on_top = np.isclose(MESH.points[:, 1], 1)
    for name, x in measure.solve_by_others(CASES["clamped"], MESH, [10], 1).items():
        np.testing.assert_allclose(
            x[on_top], 0.5 * np.cos(np.pi * MESH.points[on_top, 0]), atol=1e-14, err_msg=name
        )


@pytest.mark.parametrize("case", CASES.values(), ids=CASES)
def test_penalty_tends_to_nodal_constraints_like_one_over_its_parameter(case):
    """The classical estimate; the gap is less than 0 by the force over the parameter. Edges are 1/8 long."""
    nodal_problem = measure.assemble_nodal_problem(case, MESH, P1)
    exact = measure.solve_nodal_problem(nodal_problem)
    subset = select_constrained_nodes(nodal_problem).astype(float)
    first = measure.solve_nodal_problem(nodal_problem, 1e5 * subset / 8)
    second = measure.solve_nodal_problem(nodal_problem, 1e6 * subset / 8)
    ratio = np.abs(first - exact).max() / np.abs(second - exact).max()
    assert ratio == pytest.approx(10, rel=0.02)
    assert np.min((first - nodal_problem.g)[select_constrained_nodes(nodal_problem)]) < 0


@pytest.mark.parametrize("case", CASES.values(), ids=CASES)
def test_gauss_seidel_lowers_the_energy_and_converges_to_nodal_constraints(case):
    nodal_problem = measure.assemble_nodal_problem(case, make_structured_mesh(square(), 1 / 4), P1)
    steps = [measure.iterate_gauss_seidel(nodal_problem, sweeps) for sweeps in (1, 2, 5, 500)]
    energies = [0.5 * x @ (nodal_problem.A @ x) - nodal_problem.load @ x for x in steps]
    assert energies == sorted(energies, reverse=True)
    np.testing.assert_allclose(steps[-1], measure.solve_nodal_problem(nodal_problem), atol=1e-12)
    assert np.abs(steps[0] - steps[-1]).max() > 0.01


def test_half_the_load_is_the_problem_with_half_the_load():
    case = CASES["natural"]
    nodal_problem = measure.assemble_nodal_problem(case, MESH, P1)
    x = measure.solve_by_others(case, MESH, [10], 1)["half the load"]
    assert conditions(nodal_problem._replace(load=nodal_problem.load / 2), x) < 1e-12
    assert conditions(nodal_problem, x) > 0.01
