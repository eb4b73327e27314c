"""A solver that is used again: what is made once, what anew, and that each call is a solve of its own."""

from itertools import chain

import numpy as np
import pytest
import sentences

import unilateral as ul
from unilateral.bounds import enclosed_data
from unilateral.discrete import choice, multilevel
from unilateral.geometry import mesh as meshes
from unilateral.solution import sizes

pytestmark = pytest.mark.usefixtures("shared_cases")
SQUARE = [(0, 0), (1, 0), (1, 1), (0, 1)]
KITE = [(0, 0), (1.1, -0.3), (1.4, 1.2), (0.2, 0.8)]
FORMULAS = {"f": "exp(x) - 4*y - 2", "g": "-x/8"}
FURTHER = [
    {"g": "-x/8 - 1/20"},
    {"f": "-2 + 3*x"},
    {"f": "-2", "g": ["-x/8", "-x/8", "-x/8", "-x/8"]},
    {"f": lambda x, y: x - 2, "g": lambda x, y: -x / 9},
    {},
]
WAYS = {
    "condensed": (KITE, {"h": 1 / 8, "H": 1 / 4}, "auto"),
    "on levels": (KITE, {"h": 1 / 16, "H": 1 / 8}, "multigrid"),
}
COUNTED = {
    "meshes": (meshes, "triangulate_from_cells"),
    "made": (sizes.MESH_KINDS, "unstructured"),
    "condensations": (choice, "condense"),
    "couplings": (choice, "mixed_spaces"),
    "hierarchies": (multilevel, "build_hierarchy"),
    "cells": (multilevel, "nested_cells"),
    "enclosures of f": (enclosed_data, "enclose_source"),
}


@pytest.fixture
def counts(monkeypatch):
    """How often each of the expensive steps is taken."""
    call_counts = dict.fromkeys(COUNTED, 0)

    def counting(name, function):
        def count_calls(*arguments, **named):
            call_counts[name] += 1
            return function(*arguments, **named)

        return count_calls

    for name, (module, attribute) in COUNTED.items():
        if isinstance(module, dict):
            monkeypatch.setitem(module, attribute, counting(name, module[attribute]))
        else:
            monkeypatch.setattr(module, attribute, counting(name, getattr(module, attribute)))
    return call_counts


def list_bounds(solution):
    """Bounds on errors, and each force and reaction with its lower and upper bound."""
    bounds = solution.bounds
    forces = solution.forces()
    errors = (bounds.u, bounds.multiplier, bounds.unknown, bounds.relative_u, bounds.relative_multiplier)
    return [*chain(errors, forces.whole, *forces.sides, *forces.reactions.values())]


def same(a, b):
    for x, y in ((a.u, b.u), (a.multiplier, b.multiplier), (a.gap, b.gap), (a.mesh.points, b.mesh.points)):
        np.testing.assert_array_equal(x, y)
    # the order in which products are summed depends on where arrays lie in memory
    for x, y in zip(list_bounds(a), list_bounds(b), strict=True):
        assert x == pytest.approx(y, rel=1e-12, nan_ok=True)
    assert (a.iterations, a.converged, a.unique) == (b.iterations, b.converged, b.unique)


@pytest.mark.parametrize("way", WAYS)
def test_what_belongs_to_the_mesh_is_made_once(way, counts):
    """Control: ul.solve makes all of it each time. The problem's own f is enclosed once, too."""
    polygon, size, algorithm = WAYS[way]
    solver = ul.Solver(ul.Problem(polygon, **FORMULAS), **size, stop=ul.Stop(algorithm=algorithm))
    for further in FURTHER:
        solver(**further)
    once = dict(counts)
    assert once["meshes"] + once["made"] == 1
    assert once["condensations"] == once["couplings"] == (way == "condensed")
    assert once["hierarchies"] == once["cells"] == (way == "on levels")
    assert once["enclosures of f"] == 1 + sum("f" in further for further in FURTHER)
    for _ in range(2):
        ul.solve(ul.Problem(polygon, **FORMULAS), **size, stop=ul.Stop(algorithm=algorithm))
    again = counts["condensations"] + counts["hierarchies"]
    assert again == once["condensations"] + once["hierarchies"] + 2


def test_a_formula_is_enclosed_once_while_it_stays(counts):
    """But not a function, which may give other values each time, nor an array."""
    solver = ul.Solver(KITE, h=1 / 8, H=1 / 4)
    for f, loads in (("x", 1), ("x", 1), ("x + 0", 1), ("2*x", 2), ("x", 3)):
        solver(f, 0)
        assert counts["enclosures of f"] == loads
    factor = 1.0
    function = lambda x, y: factor * x - 3  # noqa: E731
    first = solver(function, 0).u
    factor = 2.0
    assert np.abs(solver(function, 0).u - first).max() > 0.01
    array = solver.mesh.points[:, 0] - 3
    first = solver(array, 0).u
    array *= 2
    assert np.abs(solver(array, 0).u - first).max() > 0.01


@pytest.mark.parametrize("way", WAYS)
def test_each_call_is_a_solve_of_its_own_bit_for_bit(way):
    """Whatever was solved before, and in whatever order."""
    polygon, size, algorithm = WAYS[way]
    stop = ul.Stop(algorithm=algorithm)
    solver = ul.Solver(ul.Problem(polygon, **FORMULAS), **size, stop=stop)
    single_solutions = [
        ul.solve(ul.Problem(polygon, **FORMULAS | further), **size, stop=stop) for further in FURTHER
    ]
    in_turn = [*zip(FURTHER, single_solutions, strict=True)]
    for further, expected in in_turn + in_turn[::-1]:
        same(solver(**further), expected)


def test_coefficients_free_sides_and_a_flux_stay():
    fields = {"k": "2/3", "c": 5, "free_sides": [1], "q": "y"}
    solver = ul.Solver(SQUARE, h=1 / 16, H=1 / 8, **fields)
    for f, g, q in (("-1", 0, "y"), ("-1", "-x*y", "1 - y"), (lambda x, y: x - 1, 0, "y")):
        solution = solver(f, g) if q == "y" else solver(f, g, q)
        same(solution, ul.solve(ul.Problem(SQUARE, f, g, **fields | {"q": q}), h=1 / 16, H=1 / 8))


def test_a_case_is_solved_with_its_errors_and_lends_its_polygon():
    solver = ul.Solver("natural", "1/8", "1/4")
    same(solver(), ul.solve("natural", h=1 / 8, H=1 / 4))
    assert solver().errors.h1 <= solver().bounds.u
    same(solver("-1", "-x*y"), ul.solve(ul.Problem(SQUARE, "-1", "-x*y"), h=1 / 8, H=1 / 4))
    with sentences.raises(ul.InputError):
        solver(g=0)


def test_an_own_mesh_and_a_file_are_taken():
    mesh = ul.mesh(KITE, [(0, 1, 2), (0, 2, 3)], halvings=3)
    solver = ul.Solver(mesh, H=0.4)
    same(solver(-1, 0), ul.solve(ul.Problem(mesh, -1, 0), H=0.4))
    same(solver(-1, 0), ul.Solver(ul.Problem(KITE, -1, 0), H=0.4, mesh=mesh)())
    assert solver.mesh is mesh
    assert repr(solver) == "Solver of 'problem': 81 nodes, 14 cells, h = 0.1912, H = 0.3824"


def test_warnings_point_to_the_call():
    solver = ul.Solver("natural", h=1 / 8, H=1 / 8)
    with pytest.warns(ul.SolutionWarning, match="lambda_H may not be unique") as warnings:
        solver()
    assert warnings[0].filename == __file__
    few = ul.Solver("natural", h=1 / 16, H=1 / 8, stop=ul.Stop(max_steps=3, algorithm="uzawa"))
    with pytest.warns(ul.SolutionWarning, match="did not converge") as warnings:
        few()
    assert [warning.filename for warning in warnings] == [__file__]


@pytest.mark.parametrize(
    "sample",
    [
        lambda: ul.Solver(SQUARE, 1 / 8, 1 / 4)(f=1),
        lambda: ul.Solver(SQUARE, 1 / 8, 1 / 4)(),
        lambda: ul.Solver(SQUARE, H=1 / 4),
        lambda: ul.Solver("natural", 1 / 8, 1 / 4, k=2),
        lambda: ul.Solver(3, 1 / 8, 1 / 4),
        lambda: ul.Solver(SQUARE, 1 / 8, 1 / 4, mesh="quads"),
        lambda: ul.Solver(SQUARE, 1 / 8, 1 / 4, stop=3),
        lambda: ul.Solver(SQUARE, 1 / 8, 1 / 4)(f="x+", g=0),
        lambda: ul.Solver(SQUARE, 1 / 8, 1 / 4)(f=1, g=[0, 0]),
        lambda: ul.Solver(SQUARE, 1 / 8, 1 / 4)(f=1, g=0, q=1),
    ],
)
def test_what_does_not_fit_together_is_refused(sample):
    with sentences.raises(ul.InputError):
        sample()


def test_a_problem_that_was_made_of_a_mesh_is_solved_on_that():
    mesh = ul.mesh(SQUARE, [(0, 1, 2), (0, 2, 3)], halvings=3)
    problem = ul.Problem(mesh, -1, 0)
    assert ul.solve(problem, H=1 / 4).mesh is mesh
    other_mesh = ul.mesh(mesh, halvings=1)
    for arguments, message in (
        ({"H": 1 / 4, "mesh": other_mesh}, "has a mesh of its own and is solved on it; leave mesh out"),
        ({"h": 1 / 8, "H": 1 / 4}, "the mesh is given; leave h out"),
        (
            {"accuracy": 0.1},
            "has a mesh of its own, and an accuracy chooses meshes; give H",
        ),
    ):
        with pytest.raises(ul.InputError, match=message):
            ul.solve(problem, **arguments)
