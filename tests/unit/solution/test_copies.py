"""Copies and pickles of solutions, which are plain data, and what other programs read in a file."""

import copy
import pickle
import warnings
from functools import cache

import numpy as np
import pytest
import xarray as xr
from conftest import ROOT

import unilateral as ul
from unilateral.discrete.base import DiscreteProblem
from unilateral.discrete.solution import DiscreteSolution
from unilateral.fem.condense import CondensedMatrix
from unilateral.fem.spaces import DualOperator
from unilateral.solvers.stop import Stop

SQUARE = [(0, 0), (1, 0), (1, 1), (0, 1)]
SIZES = {"h": 1 / 16, "H": 1 / 8}


def source(x, y):
    return np.cos(5 * x) - 2


def obstacle(x, y):
    return -x * y / 2


def make_clamped_problem():
    """In contact on part of sides 1 and 2, clamped on side 0."""
    return ul.Problem(SQUARE, f="x - 2", g=[None, "-x*y/3", "-x*y/3", 0], u={0: 0})


PROBLEMS = {
    "case": lambda: ul.solve(ul.case("thirds", "lshape", 1), h=1 / 8, H=1 / 4),
    "singular case": lambda: ul.solve("singular", h=1 / 8, H=1 / 4),
    "clamped": lambda: ul.solve(make_clamped_problem(), h=1 / 8, H=1 / 4),
    "multigrid": lambda: ul.solve(
        make_clamped_problem(), h=1 / 48, H=1 / 24, stop=Stop(algorithm="multigrid")
    ),
    "gmsh": lambda: ul.solve(ul.load(ROOT / "examples/shelter.yaml"), h=1 / 7, H=1 / 3),
    "accuracy": lambda: ul.solve(ul.load(ROOT / "examples/cog.yaml"), accuracy=0.3),
    "sharp accuracy": lambda: ul.solve(ul.load(ROOT / "examples/step.yaml"), accuracy=0.3, norm="hm12"),
    "units": lambda: ul.solve(ul.load(ROOT / "examples/plate.yaml"), h=5e-5, H=1e-4),
    "flux": lambda: ul.solve(
        ul.Problem(SQUARE, f="1/3", g=["-x", -1, None, 0], free_sides=[2], q="x", k="1/3"), **SIZES
    ),
    "functions": lambda: ul.solve(
        ul.Problem(SQUARE, f=source, g=[obstacle, "-y/2", "-x/2", 0], k=2), **SIZES
    ),
    "arrays": lambda: _solve_arrays(),
    "solver": lambda: ul.Solver(make_clamped_problem(), **SIZES)(f="x - 3", g=[None, "-x*y/3", "-x/3", 0]),
    "another program's": lambda: _certify_foreign(),
    "not converged": lambda: _quiet(
        ul.solve, make_clamped_problem(), **SIZES, stop=Stop(algorithm="uzawa", max_steps=3)
    ),
    "missed": lambda: _quiet(ul.solve, make_clamped_problem(), accuracy=1e-3, max_unknowns=100),
}


def _solve_arrays():
    """f, g on two sides and q on another as arrays at the nodes of a mesh that was halved."""
    mesh = ul.mesh([(0, 0), (1, 0), (1, 1), (0, 1), (0.4, 0.6)], [(0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)])
    mesh = ul.mesh(mesh, halvings=3)
    x, y = mesh.points.T
    on_sides = [-x * y, -x * y / 2 - y / 2, None, 0]
    problem = ul.Problem(mesh, f=x - 2, g=on_sides, free_sides=[2], q=[None, None, x - 1, None], k="1/3")
    return ul.solve(problem, H=1 / 4)


def _certify_foreign():
    s = ul.solve(ul.Problem(SQUARE, f="x - 2", g="-x*y/3"), **SIZES)
    return _quiet(ul.certify, s.problem, s.mesh, s.u + 0.01)


def _quiet(call, *arguments, **named):
    with warnings.catch_warnings(action="ignore", category=ul.SolutionWarning):
        return call(*arguments, **named)


@cache
def solve_once(name):
    """Each of the problems, solved once."""
    return PROBLEMS[name]()


def values(s):
    """What users see of a solution; of its arrays the bytes."""
    arrays = [s.u, s.multiplier, s.gap, s.mesh.points, s.mesh.triangles]
    points = np.random.default_rng(1).uniform(*np.array(s.polygon.vertices)[[0, 2]], (20, 2))
    arrays += [s.u_at(points), s.grad_at(points), s.flux_at(points)]
    expected = [s.bounds, s.sharp_bounds, s.forces().whole, s.forces().reactions, s.certificate()]
    return [[array.tobytes() for array in arrays], repr(expected), repr(s), s.contact.intervals]


WAYS = {
    "copy": copy.copy,
    "deep copy": copy.deepcopy,
    "pickle": lambda s: pickle.loads(pickle.dumps(s)),
}


@pytest.mark.parametrize(
    ("name", "way"),
    [(name, "pickle") for name in PROBLEMS]
    + [(name, way) for name in ("flux", "accuracy") for way in ("copy", "deep copy")],
)
def test_copies_and_pickles_are_the_same(name, way):
    """Bit for bit: what was computed before it was copied, and what is computed from the copy."""
    s = PROBLEMS[name]()
    before = WAYS[way](s)
    expected = values(s)
    assert values(before) == expected
    assert values(WAYS[way](s)) == expected


def test_another_solution_is_not_the_same():
    """Control: of finer cells."""
    assert values(solve_once("clamped")) != values(ul.solve(make_clamped_problem(), h=1 / 8, H=1 / 2))


def test_copies_of_problems_are_solved_alike():
    for name in ("case", "clamped", "flux"):
        problem = solve_once(name).problem
        again = pickle.loads(pickle.dumps(problem))
        solution = ul.solve(again, h=1 / 8, H=1 / 4)
        other_solution = ul.solve(problem, h=1 / 8, H=1 / 4)
        np.testing.assert_array_equal(solution.u, other_solution.u)


def collect_values(value, calls):
    """Everything that an object is made of."""
    if id(value) in calls or isinstance(value, np.ndarray | str | float | int | type(None)):
        return
    calls[id(value)] = value
    inner = (
        list(value.values())
        if isinstance(value, dict)
        else list(value)
        if isinstance(value, list | tuple)
        else []
    )
    for member in [*inner, *vars(value).values()] if hasattr(value, "__dict__") else inner:
        collect_values(member, calls)


@pytest.mark.parametrize("name", ["case", "multigrid", "accuracy"])
def test_a_solution_holds_no_solver(name):
    """No discrete problem, no factors, no matrices; control: a solver holds them."""
    alive = {}
    solver = {}
    collect_values(solve_once(name), alive)
    collect_values(ul.Solver(make_clamped_problem(), **SIZES), solver)
    forbidden = (DiscreteProblem, CondensedMatrix, DualOperator)
    assert any(isinstance(value, DiscreteSolution) for value in alive.values())
    assert not [value for value in alive.values() if isinstance(value, forbidden)]
    assert [attribute for attribute in solver.values() if isinstance(attribute, forbidden)]
    modules = {type(value).__module__.partition(".")[0] for value in alive.values()}
    assert "scipy" not in modules
    assert "scipy" in {type(attribute).__module__.partition(".")[0] for attribute in solver.values()}


def test_withdrawn_bounds_stay_withdrawn(monkeypatch):
    """Of a solution none of whose levels is believed; control: as it is, it has bounds."""
    assert solve_once("accuracy").bounds is not None
    monkeypatch.setattr("unilateral.adaptive.level.contradict", lambda a, b: True)
    s = _quiet(ul.solve, make_clamped_problem(), accuracy=0.3)
    assert s.bounds is None
    for again in (pickle.loads(pickle.dumps(s)), copy.deepcopy(s)):
        assert again.bounds is None
        assert not again.certified


def test_a_file_is_read_without_this_package(tmp_path):
    """By xarray, all digits; the two bounds are in it for other readers."""
    s = solve_once("flux")
    s.save(tmp_path / "s.nc")
    with xr.open_dataset(tmp_path / "s.nc") as table:
        np.testing.assert_array_equal(table["u"], s.u)
        np.testing.assert_array_equal(table["multiplier"], s.multiplier)
        np.testing.assert_array_equal(table["gap"], s.gap)
        np.testing.assert_array_equal(np.stack([table["x"], table["y"]], axis=1), s.mesh.points)
        np.testing.assert_array_equal(table["triangles"], s.mesh.triangles)
        assert table.attrs["Conventions"] == "CF-1.8"
        assert table.attrs["h1_bound"] == s.bounds.u
        assert table.attrs["hm12_bound"] == s.bounds.multiplier
