"""The public face: problems of functions, own meshes, warnings and refusals."""

import math
import re
import warnings
from dataclasses import replace
from decimal import Decimal
from fractions import Fraction
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import sentences
import sympy
from conftest import DATA, ROOT

import unilateral as ul
from unilateral.adaptive import forecast
from unilateral.fem.p1 import energy_norm
from unilateral.formulas.decimals import format_up
from unilateral.geometry.files import write_mesh
from unilateral.geometry.polygon import square
from unilateral.geometry.structured import make_structured_mesh
from unilateral.solution.record import make_solution_record
from unilateral.solvers.stop import ALGORITHMS

pytestmark = pytest.mark.usefixtures("shared_cases")
SQUARE = [(0, 0), (1, 0), (1, 1), (0, 1)]
SIZES = {"h": 1 / 16, "H": 1 / 8}


def test_all_that_is_public_is_there_and_typed():
    stub = (ROOT / "src/unilateral/__init__.pyi").read_text()
    assert {*re.findall(r"import (\w+) as \1", stub)} == {*ul.__all__}
    assert all(getattr(ul, name) for name in ul.__all__)
    with pytest.raises(AttributeError, match="no attribute 'solv'"):
        _ = ul.solv


def test_functions_give_the_solution_of_their_formulas():
    """These f and g are linear on triangles and edges. For an accuracy functions are refused."""
    formulas = ul.Problem(SQUARE, f="x - 2", g=["-x*y/2", "-y/2", "-x/2", 0])
    functions = ul.Problem(
        SQUARE, f=lambda x, y: x - 2, g=[lambda x, y: -x * y / 2, "-y/2", lambda x, y: -x / 2, 0]
    )
    stop = ul.Stop(tolerance=1e-10)
    formula_solution = ul.solve(formulas, **SIZES, stop=stop)
    function_solution = ul.solve(functions, **SIZES, stop=stop)
    np.testing.assert_allclose(function_solution.u, formula_solution.u, rtol=0, atol=1e-8)
    assert function_solution.errors is None
    assert function_solution.bounds.u == pytest.approx(formula_solution.bounds.u, rel=1e-6)
    assert function_solution.bounds.multiplier == pytest.approx(formula_solution.bounds.multiplier, rel=1e-6)
    with sentences.raises(ul.InputError):
        ul.solve(functions, accuracy=0.1)


@pytest.mark.parametrize("algorithm", ["auto", "multigrid"])
@pytest.mark.parametrize(
    ("f", "g", "message"),
    [
        (lambda x, y: np.sqrt(x - 0.5), 0, "problem, field f: the function is nan at"),
        (-1, lambda x, y: 1 / (0 * x), r"problem, field g\[0\]: the function is inf at \(0"),
        (
            lambda x, y: x + 1j * y,
            0,
            "problem, field f, value of the function: it holds values of the type complex128",
        ),
    ],
)
def test_a_function_that_gives_no_number_is_refused(algorithm, f, g, message):
    """An iteration on such data would never end."""
    with pytest.raises(ul.InputError, match=message):
        ul.solve(ul.Problem(SQUARE, f=f, g=g), **SIZES, stop=ul.Stop(algorithm=algorithm))


POINTWISE = (
    "the function takes one point at a time, and no arrays (",
    "such as np.sin and np.where, or give np.vectorize(function, otypes=[float])",
)
ARGUMENTS = "it has to take two, x and y, such as lambda x, y: x - y; of a function u of points write"
INTEGERS = (
    "value of the function: the values are integers (int",
    "give floating-point numbers, as",
    "otypes=[float]",
)
EACH = "it has to return a real number for each point"


@pytest.mark.parametrize(
    ("function", "reasons"),
    [
        (lambda x, y: 1 if x > 0.5 else 0, POINTWISE),
        (lambda x, y: math.sin(x), POINTWISE),
        (max, POINTWISE),
        (lambda p: p[0], ("the function takes the arguments (p)", ARGUMENTS)),
        (lambda: 1, ("the function takes the arguments ()", ARGUMENTS)),
        (lambda x, y, z: x, ("the function takes the arguments (x, y, z)", ARGUMENTS)),
        (lambda x, y: np.zeros(7), ("the function returns an array of the shape (7,) for x and y", EACH)),
        (lambda x, y: (x, y), ("the function returns an array of the shape (2, ", EACH)),
        (lambda x, y: x[..., None] + [1, 2], ("the function returns an array of the shape (", EACH)),
        (lambda x, y: "a", ("value of the function: it is 'a'", EACH)),
        (lambda x, y: None, ("value of the function: it is None", EACH)),
        (lambda x, y: np.ma.masked_greater(x, -1), ("value of the function: ", "numbers are masked")),
        (lambda x, y: x + 1j, ("it holds values of the type complex128", EACH)),
        (np.vectorize(lambda x, y: 0 if x < 0.5 else -1.5), INTEGERS),
        (lambda x, y: np.where(x > 0.5, 1, 0), INTEGERS),
        (lambda x, y: np.zeros(x.shape, np.int8), INTEGERS),
        (lambda x, y: x > 0.5, ("it holds values of the type bool", EACH)),
        (lambda x, y: {}, ("value of the function: it is {}", EACH)),
        (
            lambda x, y: 1 / 0,
            ("the function failed (ZeroDivisionError: division by zero)", "two arrays x and y"),
        ),
        (lambda x, y: x / 0, ("the function is ",)),
    ],
)
def test_a_function_that_does_not_give_a_number_for_each_point_is_refused(function, reasons):
    """As f and as g, on a mesh that is given and on one of a size."""
    for field, solve in (
        ("f", lambda: ul.solve(ul.Problem(SQUARE, f=function, g=0), **SIZES)),
        ("g", lambda: ul.Problem(ul.mesh(SQUARE, [(0, 1, 2), (0, 2, 3)]), f=0, g=function)),
    ):
        with pytest.raises(ul.InputError) as error:
            solve()
        assert re.match(rf"problem, field {field}(\[0\])?[:,] ", str(error.value))
        assert all(reason in str(error.value) for reason in reasons), error.value


def test_functions_of_any_type_and_ones_that_overwrite_their_arguments_give_the_same_u():
    """All are -1 - x or -1; the last is what a message on a function of single points says."""
    formulas = {form: ul.solve(ul.Problem(SQUARE, f=form, g=0), **SIZES).u for form in ("-1 - x", "-1")}

    def overwriting(x, y):
        x *= -1
        x -= 1
        return x

    for form, functions in {
        "-1": [lambda x, y: -1, lambda x, y: np.full(x.shape, -1, np.float32), lambda x, y: [[-1.0]]],
        "-1 - x": [overwriting, np.vectorize(lambda x, y: -1 - x, otypes=[float]), lambda x, y, k=1: -k - x],
    }.items():
        for f in functions:
            u = ul.solve(ul.Problem(SQUARE, f=f, g=0), **SIZES).u
            np.testing.assert_allclose(u, formulas[form], rtol=0, atol=1e-4)


def test_functions_that_jump_at_a_vertex_are_refused():
    """As formulas are; by less than half of the digits they may differ, and beside a free side at will."""
    mesh = ul.mesh(SQUARE, [(0, 1, 2), (0, 2, 3)])
    jumping = [lambda x, y: x, 1, lambda x, y: 1.5 + 0 * x, 0]
    with sentences.raises(ul.InputError, "vertex 2"):
        ul.Problem(mesh, f=0, g=jumping)
    with sentences.raises(ul.InputError, "vertex 0"):
        ul.Problem(mesh, f=0, g=[lambda x, y: x, 1, 1, 1])
    assert ul.Problem(mesh, f=0, g=[jumping[0], 1, None, 0], free_sides=[2]).g


@pytest.mark.parametrize("size", [1e-130, 1.0, 1e130])
def test_what_counts_as_a_jump_is_relative_to_the_functions(size):

    def constant(change):
        return lambda x, y: size * (1 + change) + 0 * x

    same = constant(0)
    near = constant(1e-9)
    far = constant(1e-7)
    mesh = ul.mesh(SQUARE, [(0, 1, 2), (0, 2, 3)])
    assert ul.Problem(mesh, f=0, g=[same, near, near, near]).g
    with pytest.raises(ul.InputError, match="it jumps at vertex 0"):
        ul.Problem(mesh, f=0, g=[same, far, far, far])


def test_bounds_of_a_case_are_above_its_errors():
    """The bounds are above the errors, 30 % and 10 % at most; the dual norm lies between its bounds."""
    s = ul.solve(ul.case("natural"), **SIZES)
    assert s.errors.h1 <= s.bounds.u <= 1.3 * s.errors.h1
    assert s.errors.h1 <= s.sharp_bounds.u <= 1.1 * s.errors.h1
    assert s.errors.hm12_lower <= s.errors.hm12_upper <= s.sharp_bounds.multiplier <= s.bounds.multiplier
    assert not s.certified
    assert s.iterations > 0


def test_an_accuracy_is_certified_and_its_levels_are_told():
    messages = []
    s = ul.solve(ul.load(DATA / "problems/triangle.yaml"), accuracy=0.2, tell=messages.append)
    assert s.certified
    assert len(messages) == len(s.search.levels)
    assert s.iterations == sum(level.solved.result.iterations for level in messages)


def test_an_accuracy_that_was_missed_is_warned_of_with_the_reason_and_the_bound():
    """By the bound that the solution has, rounded up; neither a reached one nor a plan is warned of."""
    with pytest.warns(ul.SolutionWarning) as caught:
        s = ul.solve(ul.case("natural"), accuracy="1/1000", max_unknowns=100)
    bound = format_up(s.bounds.u, ".4e")
    share = format_up(s.certificate()["h1_relative_bound"], ".3g")
    why = "the accuracy 0.001 is not certified: out of budget (max_unknowns=100)"
    text = f"{why}; reached is {share} of ||u||_1, or {bound}"
    assert [str(warning.message) for warning in caught] == [text]
    assert caught[0].filename == __file__
    assert not s.certified
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert ul.solve(ul.case("natural"), accuracy=0.3).certified
        ul.solve(ul.case("natural"), accuracy=1e-3, dry_run=True)


@pytest.mark.parametrize(
    ("sizes", "advice"),
    [
        ({"h": 1 / 8, "H": 1 / 8}, "take h < H, such as H = 2h"),
        ({"h": 3, "H": 6}, "a side of the length 1 is one edge; take h <= 0.5 and H = 2h"),
    ],
)
def test_a_multiplier_that_may_not_be_unique_is_warned_of(sizes, advice):
    with pytest.warns(ul.SolutionWarning) as warnings:
        s = ul.solve(ul.case("natural"), **sizes)
    texts = [str(warning.message) for warning in warnings if warning.category is ul.SolutionWarning]
    assert texts == [f"lambda_H may not be unique, because beta is 0 up to rounding; {advice}"]
    assert not s.unique
    assert ul.solve(ul.case("natural"), h=0.5, H=1).unique


def test_a_multiplier_that_may_not_be_unique_on_a_mesh_of_one_s_own(tmp_path):
    """Nobody can give its h. Where each side has two edges it says to take larger cells, and that helps."""
    write_mesh(make_structured_mesh(square(), 1), tmp_path / "own.vtu")
    mesh = ul.mesh(tmp_path / "own.vtu")
    single = r"two edges of the mesh or more, and side 0 is one; take ul\.mesh\(mesh, halvings=1\)$"
    with pytest.warns(ul.SolutionWarning, match=single):
        ul.solve(ul.Problem(mesh.polygon, f=-1, g=0), H=1, mesh=mesh)
    finer = ul.mesh(mesh, halvings=1)
    with pytest.warns(ul.SolutionWarning, match="take larger cells, or refine the mesh at the boundary$"):
        ul.solve(ul.Problem(finer, f=-1, g=0), H=1 / 2)
    assert ul.solve(ul.Problem(finer, f=-1, g=0), H=1).unique


def test_an_iteration_that_did_not_converge_is_warned_of_once():
    """At the call, with the bound that is left; control: without the limit of its steps it converges."""
    for expected, message in (
        (SIZES, r"the iteration did not converge: the algebraic error is at most \S+ after 3 steps; "),
        ({"accuracy": 1e-3}, r"not certified: the iteration did not converge \(max_steps=, .*; reached is "),
    ):
        with warnings.catch_warnings(record=True) as report:
            warnings.simplefilter("always")
            s = ul.solve("natural", **expected, stop=ul.Stop(max_steps=3, algorithm="uzawa"))
        assert not s.converged
        assert [(warning.category, warning.filename) for warning in report] == [
            (ul.SolutionWarning, __file__)
        ]
        assert re.search(message, str(report[0].message))
    with warnings.catch_warnings(action="error"):
        assert ul.solve("natural", **SIZES, stop=ul.Stop(algorithm="uzawa")).converged


@pytest.mark.parametrize("algorithm", ["uzawa", "nesterov", "auto"])
def test_a_rho_with_which_steps_need_not_converge_is_refused_at_once(algorithm):
    """Above 2 / lambda_max(S), by (5.2), or 1 / lambda_max(S) for Nesterov's steps, by eigenvalues of S."""
    S = ul.Solver("natural", **SIZES).matrices().S
    limit = {"nesterov": 1.0}.get(algorithm, 2.0) / np.linalg.eigvalsh(S)[-1]
    for factor in (1.001, 1e3):
        stop = ul.Stop(algorithm=algorithm, rho=factor * limit)
        with pytest.raises(ul.InputError, match=rf"rho = .* is too large: .* = {limit:.4g}; take a smaller"):
            ul.solve("natural", **SIZES, stop=stop)
    with pytest.raises(ul.InputError, match="is too large"):
        ul.solve("natural", accuracy=0.1, stop=ul.Stop(algorithm=algorithm, rho=10))
    assert ul.solve("natural", **SIZES, stop=ul.Stop(algorithm=algorithm, rho=0.999 * limit)).converged


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_a_tolerance_below_rounding_ends_soon_and_is_told(algorithm):
    """Without all of max_steps; what is reached is as small as by the active set, which makes no steps."""
    with pytest.warns(ul.SolutionWarning, match="rounding al.*; take a larger tolerance"):
        s = ul.solve("natural", **SIZES, stop=ul.Stop(algorithm=algorithm, tolerance=1e-18))
    assert not s.iterations > 10_000
    assert s.solved.result.bound < 4e-12
    ul.solve("natural", **SIZES, stop=ul.Stop(algorithm=algorithm, tolerance=1e-11))


@pytest.mark.parametrize("absolute", [False, True])
def test_an_accuracy_within_reach_is_told_in_the_terms_of_the_one_that_was_missed(absolute, monkeypatch):
    """Relative ones as parts of the norm, absolute ones as errors; the one in reach is above that wanted."""
    monkeypatch.setattr(forecast, "MIN_PLAN_UNKNOWNS", 400)
    with pytest.warns(ul.SolutionWarning) as warnings:
        s = ul.solve("natural", accuracy=1e-9, absolute=absolute)
    reached = format_up(s.search.best.total, ".4e")
    if not absolute:
        reached = f"{format_up(s.certificate()['h1_relative_bound'], '.3g')} of ||u||_1, or {reached}"
    message = str(warnings[0].message)
    assert message.startswith("the accuracy 1e-09 is not certified: out of reach (")
    assert message.endswith(f"; reached is {reached}; an accuracy of {s.search.reach:g} is within reach")
    assert "max_memory=" not in message


def test_names_and_texts_are_taken_for_what_they_mean(tmp_path):
    expected = ul.solve(ul.case("natural"), **SIZES).u
    np.testing.assert_array_equal(ul.solve("natural", h="1/16", H="0.125").u, expected)
    file = tmp_path / "own.yaml"
    file.write_text("polygon: [[0, 0], [1, 0], [1, 1], [0, 1]]\nf: -1\ng: 0\n")
    expected = ul.solve(ul.Problem(SQUARE, f=-1, g=0), **SIZES).u
    for name in (file, str(file)):
        np.testing.assert_array_equal(ul.solve(name, **SIZES).u, expected)


def test_numbers_of_other_libraries_are_taken_exactly():
    """As the formulas that they mean; sides may be counted by NumPy, and None is no side and no flux."""
    formulas = ul.Problem(SQUARE, f="-1/3", g="1/4", k="1/10", free_sides=[2])
    problem = ul.Problem(
        np.array(SQUARE, dtype=np.int8),
        f=Fraction(-1, 3),
        g=np.float32(0.25),
        k=Decimal("0.1"),
        c=np.array(1.0),
        free_sides=np.array([2]),
        q=None,
    )
    assert (problem.f, problem.g, problem.k, problem.c) == (formulas.f, formulas.g, formulas.k, formulas.c)
    assert problem.free_sides == (2,)
    assert ul.Problem(SQUARE, f=0, g=0, free_sides=None).free_sides == ()


def test_a_name_stays_what_it_is():
    for f in ("-1", lambda x, y: -1):
        assert ul.Problem(SQUARE, f=f, g=0, name="a/b 1.5").name == "a/b 1.5"


def test_bounds_that_do_not_fit_into_the_memory_are_warned_of(monkeypatch):
    """4225 unknowns take 1 MB, sharply 6 MB; control: those that are known."""
    monkeypatch.setattr("unilateral.solution.bounds.available_mb", lambda: 2.0)
    s = ul.solve("natural", h=1 / 64, H=1 / 32)
    with pytest.warns(ul.SolutionWarning) as caught:
        assert s.sharp_bounds is None
    text = "no guaranteed bound: it takes about 6 MB, and 2 MB are free"
    assert [(str(warning.message), warning.filename) for warning in caught] == [(text, __file__)]
    with warnings.catch_warnings(action="error"):
        assert s.bounds.u > 0
        monkeypatch.setattr("unilateral.solution.bounds.available_mb", lambda: 0.0)
        assert s.bounds.u > 0


def test_relative_bounds_are_parts_of_lower_bounds_of_the_norms():
    """The bound over the discrete norm less the bound, or a little more for rounding; NaN for u = 0."""
    s = ul.solve("natural", **SIZES)
    for sharp, bounds in ((False, s.bounds), (True, s.sharp_bounds)):
        size = energy_norm(s.mesh, s.u) - bounds.u
        assert bounds.u / size <= bounds.relative_u <= (1 + 1e-6) * bounds.u / size
        assert (
            bounds.relative_multiplier
            == make_solution_record(s, bounds, None, sharp)["hm12_relative_bound"]
            > 0
        )
    exact = energy_norm(s.mesh, s.problem.exact.value_and_gradient(s.mesh.points)[0])
    assert s.errors.h1 / exact < s.bounds.relative_u
    nothing = ul.solve(ul.Problem(SQUARE, f=0, g=-1), **SIZES).bounds
    assert math.isnan(nothing.relative_u)
    assert math.isnan(nothing.relative_multiplier)


def test_bounds_that_are_withdrawn_and_levels_that_are_refused_are_told(monkeypatch):
    """A fault that nobody knows of is simulated: the levels' bounds are said to contradict each other."""
    monkeypatch.setattr("unilateral.adaptive.level.contradict", lambda a, b: True)
    with pytest.warns(ul.SolutionWarning) as warnings:
        s = ul.solve("natural", accuracy=0.3)
    assert not s.certified
    assert s.bounds is None
    number = len(s.search.levels)
    assert f"{number} bounds withdrawn, because they contradict each other; please report it" in str(
        warnings[0].message
    )
    assert "not certified: bounds contradict each other; no bound is left" in str(warnings[1].message)


def test_a_mesh_of_one_s_own_gives_the_bounds_of_the_same_mesh(tmp_path):
    """Its outline is the polygon; h is not given; on another polygon it is refused.

    What is unknown of these f and g is rounding, of which a mesh that was refined has more: some 1e-13.
    """
    write_mesh(make_structured_mesh(square(), 1 / 8), tmp_path / "own.vtu")
    mesh = ul.mesh(tmp_path / "own.vtu")
    problem = ul.Problem(mesh.polygon, f=-1, g="-x*y/2")
    solution = ul.solve(problem, H=1 / 4, mesh=mesh)
    same = ul.solve(problem, h=1 / 8, H=1 / 4)
    assert solution.bounds.u == pytest.approx(same.bounds.u, rel=1e-6)
    assert solution.bounds.multiplier == pytest.approx(same.bounds.multiplier, rel=1e-6)
    with sentences.raises(ul.InputError, "leave h out"):
        ul.solve(problem, h=1 / 8, H=1 / 4, mesh=mesh)
    with sentences.raises(ul.InputError, "mesh"):
        ul.solve(ul.case("reentrant"), H=1 / 4, mesh=mesh)


def test_bounds_that_contradict_each_other_are_none():
    s = ul.solve(ul.case("natural"), accuracy=0.3)
    assert s.bounds is not None
    vars(s.search)["believed"] = []  # in place of what it would find
    assert replace(s).bounds is None


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"h": 1 / 8}, "h and H are needed, and H is missing; if all data are formulas, ul.solve takes an"),
        ({"absolute": True}, "absolute is only for an accuracy; leave it out, or give an accuracy"),
        ({"H": 1 / 8}, "and h is missing"),
        ({"h": -1, "H": 1 / 8}, "h = -1 must be a positive number"),
        ({"h": "1/x", "H": 1 / 8}, "h: 'x' is unknown"),
        ({"h": [1], "H": 1 / 8}, "h is [1]; it has to be a number, or a text such as '1/64'"),
        ({"accuracy": {}}, "the accuracy is {}; it has to be a number"),
        ({"h": 1e-9, "H": 1 / 8}, "h = 1e-09 makes 1e+18 unknowns on 'problem', which take at least"),
        ({"h": 1 / 8, "accuracy": 0.1}, "an accuracy makes its own meshes; leave it out, or"),
        ({"accuracy": 10**400}, "the accuracy is 1000000"),
        (
            {"accuracy": 0.1, "mesh": "quads"},
            "the mesh is 'quads'; it has to be structured or unstructured, or",
        ),
        ({"accuracy": 0.1, "norm": "l2"}, "the norm 'l2' is none of h1, hm12"),
        ({"accuracy": 2}, "the accuracy 2 is relative and must be below 1, or made absolute (absolute=)"),
        (
            {"mesh": "quads", **SIZES},
            "the mesh is 'quads'; it has to be structured or unstructured, or a mesh",
        ),
        ({"mesh": 3, **SIZES}, "the mesh is 3; it has to be structured or unstructured, or a mesh such as"),
        ({"mesh": Path("own.msh"), "H": 1}, "own.msh'); it has to be structured or unstructured"),
        ({"h": True, "H": 2}, "h is True; it has to be a number"),
        ({"h": np.array([0.1, 0.2]), "H": 1}, "h is array([0.1, 0.2]); it has to be a number"),
        ({"accuracy": 0.1, "norm": None}, "the norm 'None' is none of h1, hm12"),
        ({"accuracy": 0.1, "tell": 3}, "tell has to be a function of a level"),
        ({"accuracy": 0.1, "begin": "now"}, "begin: 'now' is unknown"),
        ({"accuracy": 0.1, "sharp": "no"}, "sharp is 'no'; it has to be True or False"),
        ({"dry_run": True, **SIZES}, "dry_run is only for an accuracy; leave it out, or give an accuracy"),
        ({"max_unknowns": 10, **SIZES}, "max_unknowns is only for an accuracy"),
        ({"norm": "hm12", **SIZES}, "norm is only for an accuracy"),
        ({"absolute": True, **SIZES}, "absolute is only for an accuracy"),
        ({"stop": 3, **SIZES}, "stop is 3; it has to be one such as ul.Stop(tolerance=1e-8)"),
    ],
)
def test_what_does_not_fit_together_is_refused(arguments, message):
    with pytest.raises(ul.InputError, match=re.escape(message)):
        ul.solve(ul.Problem(SQUARE, f=-1, g=0), **arguments)


@pytest.mark.parametrize(
    ("argument", "message"),
    [
        (lambda: ul.solve(3, **SIZES), "3 is not a problem; take ul.Problem"),
        (lambda: ul.solve("naturl", **SIZES), "natural"),
        (lambda: ul.load(3), "3 is no name; give a text such as 'problem.yaml', or a Path"),
        (lambda: ul.solve("", **SIZES), "'' is no name"),
        (lambda: ul.load(b"natural"), "b'natural' is no name"),
        (lambda: ul.load("a\0.yaml"), "is no name"),
        (lambda: ul.case(None), "None is no name; give a text such as 'natural'"),
        (lambda: ul.case("natural", SQUARE), "is no name; give a text such as 'square'"),
        (lambda: ul.case("natural", side="a"), "side: the polygon has the sides 0 to 3, not 'a'; a side"),
        (lambda: ul.case("natural", side=1.5), "side: the polygon has the sides 0 to 3, not 1.5"),
        (lambda: ul.case("natural", free_sides=3), "free sides: it is 3; it has to be a list of sides"),
        (
            lambda: ul.case("natural", free_sides=[1.0]),
            "free sides: the polygon has the sides 0 to 3, not 1.0",
        ),
        (lambda: ul.Stop(fraction="x"), "fraction is 'x'; it has to be a number"),
        (lambda: ul.Stop(fraction=True), "fraction is True; it has to be a number"),
        (lambda: ul.Stop(fraction=None), "fraction is None; it has to be a number"),
        (lambda: ul.Stop(fraction=-1), "fraction is -1; it has to be a positive number"),
        (lambda: ul.Stop(tolerance=math.nan), "tolerance is nan; it has to be a positive number"),
        (lambda: ul.Stop(rho=1j), "rho is 1j; it has to be a number"),
        (lambda: ul.Stop(max_steps=1e5), "max_steps is 100000.0; it has to be a whole number"),
        (lambda: ul.Stop(algorithm=None), "the algorithm 'None' is unknown"),
    ],
)
def test_what_is_no_problem_no_path_and_no_number_is_refused(argument, message):
    with pytest.raises(ul.InputError, match=message):
        argument()


@pytest.mark.parametrize("name", ["max_unknowns", "max_seconds", "max_memory"])
@pytest.mark.parametrize(
    ("data", "message"),
    [
        ("x", "'x' is unknown"),
        ([3], r"is \[3\]; it has to be a number"),
        (math.nan, "above 0"),
        (-1, "above 0"),
    ],
)
def test_limits_that_are_none_are_refused(name, data, message):
    with pytest.raises(ul.InputError, match=f"{name}.*{message}"):
        ul.solve(ul.case("natural"), accuracy=0.1, **{name: data})


@pytest.mark.parametrize("name", ["max_unknowns", "max_seconds", "max_memory"])
def test_limits_may_be_text(name):
    """Control: they are not refused."""
    assert ul.solve(ul.case("natural"), accuracy=0.5, **{name: "3000"}).certified


def test_a_limit_that_leaves_no_result_is_an_error_of_its_own():
    with pytest.raises(ul.BudgetError, match="max_seconds=1e-09 is not enough"):
        ul.solve(ul.case("natural"), accuracy=0.1, max_seconds=1e-9)
    assert issubclass(ul.BudgetError, ul.InputError)


NO_SIDES = (-1, 4, 1.5, "1", "left", True, None)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"f": "x+"}, "problem, field f: 'x+' is not a formula in x, y"),
        ({"f": None}, "problem, field f: there is no formula; write 0 where there is none"),
        (
            {"g": None},
            "field g: it is missing, and side 0 is neither free nor clamped; write one formula for",
        ),
        ({"g": [0, 0]}, "problem, field g: 2 formulas for 4 sides"),
        ({"g": [np.hypot, 0]}, "problem, field g: 2 formulas for 4 sides"),
        (
            {"f": np.hypot, "free_sides": [7]},
            "problem, field free_sides: the polygon has the sides 0 to 3, not 7",
        ),
        ({"polygon": SQUARE[::-1]}, "problem, field polygon: "),
        (
            {"polygon": [(0, 0), (1, 0), (1,)]},
            "field polygon: it is [(0, 0), (1, 0), (1,)]; it has to be a list of",
        ),
        ({"polygon": [(0, 0), (1, 0), ("a", 1)]}, "it has to be a list of pairs (x, y), anticlockwise"),
        ({"polygon": "square"}, "field polygon: square cannot be read: No such file"),
        ({"polygon": None}, "field polygon: it is None; it has to be a list of pairs"),
        ({"polygon": [0, 1, 1 + 1j]}, "it has to be a list of pairs"),
        ({"polygon": np.array([[0, 0], [1, 0], [1, 1j]])}, "it has to be a list of pairs"),
        ({"polygon": [(0, 0), (10**400, 0), (0, 1)]}, "it has to be a list of pairs"),
        ({"polygon": {(0, 0), (1, 0), (0, 1)}}, "it has to be a list of pairs"),
        (
            {"polygon": [(0, 0, 0), (1, 0, 0), (0, 1, 0)]},
            "field polygon: it has the shape (3, 3); it has to be",
        ),
        (
            {"polygon": np.array(SQUARE).T},
            "it has the shape (2, 4); it has to be a list of pairs (x, y), antic",
        ),
        ({"polygon": np.array(SQUARE).T}, "; transpose it"),
        ({"polygon": SQUARE[:2]}, "field polygon: it has 2 vertices; a polygon has at least three"),
        ({"polygon": [(0, 0), (1, 0), (math.nan, 1)]}, "polygon[2]: it is (nan, 1.0); it has to be finite"),
        ({"f": math.nan}, "field f: it is nan; it has to be a finite number, or a formula"),
        ({"f": 1j}, "field f: it is 1j; it has to be a finite number, or a formula"),
        ({"f": sympy.Symbol("x") - 1}, "field f: it is x - 1; write it as a text, as str(x - 1) does"),
        ({"f": [1, 2]}, "field f: it is [1, 2]; it has to be a formula, a function or an array"),
        ({"f": pd.Series([1, 2])}, "field f: an array has a value for each node of a mesh; give the mesh"),
        ({"g": [math.inf, 0, 0, 0]}, "field g[0]: it is inf; it has to be a finite number"),
        ({"g": {0: 0}}, "field g[1]: there is no formula, and side 1 is neither free nor clamped"),
        ({"free_sides": 3}, "field free_sides: it is 3; it has to be a list of sides, such as [0, 2]"),
        ({"free_sides": "1"}, "field free_sides: it is '1'; it has to be a list of sides"),
        ({"free_sides": ["1"]}, "field free_sides: the polygon has the sides 0 to 3, not '1'; a side"),
        ({"free_sides": [1.5]}, "field free_sides: the polygon has the sides 0 to 3, not 1.5"),
        ({"free_sides": [True]}, "field free_sides: the polygon has the sides 0 to 3, not True"),
        ({"free_sides": [-1]}, "field free_sides: the polygon has the sides 0 to 3, not -1"),
        *[
            ({"u": {side: 0}}, f"field u: the polygon has the sides 0 to 3, not {side!r}")
            for side in NO_SIDES
        ],
        (
            {"u": {1: 0}, "free_sides": [1]},
            "field free_sides: side 1 is clamped; remove it from free_sides or",
        ),
        ({"u": {1: 0}, "g": [0] * 4}, "field g[1]: side 1 is clamped; write null, or take it out of u"),
        ({"u": {1: 0}, "q": [None, np.hypot, None, None]}, "field q[1]: side 1 is clamped; write null"),
        (
            {"u": {1: "None"}},
            "field u[1]: 'None' is no formula; write the value of u, such as 0, or leave the",
        ),
        ({"k": math.nan}, "field k: it is nan; it has to be a finite number"),
        ({"k": lambda x, y: 1}, "field k: it is <function"),
        ({"c": None}, "field c: it is None; it has to be an exact number"),
        ({"name": None}, "name is None; it has to be a text"),
        ({"name": ""}, "name is ''; it has to be a text"),
        (
            {"f": np.hypot, "g": [None, 0, 0, 0]},
            "there is no formula, and side 0 is neither free nor clamped",
        ),
    ],
)
def test_a_bad_problem_is_refused_in_one_sentence(fields, message):
    all_fields = {"polygon": SQUARE, "f": -1, "g": 0} | fields
    with pytest.raises(ul.InputError, match=re.escape(message)):
        ul.Problem(**all_fields)


@pytest.mark.parametrize("k", [1, 2])
def test_a_given_u_that_is_infinite_inside_a_side_is_named(k):
    """Around (1/2, 0) on side 0; control: the same function as a g is named g."""

    def pole(x, y):
        return np.where(abs(x - 0.5) < 0.1, -np.inf, -1)

    for field, fields in (("u", {"g": -9, "u": {0: pole}}), ("g", {"g": [pole, -1, -1, -1]})):
        problem = ul.Problem(SQUARE, -1, **fields, k=k)
        with sentences.raises(ul.InputError, f"field {field}[0]"):
            ul.solve(problem, h=1 / 8, H=1 / 4)


def test_parts_of_the_boundary_are_sides_that_there_are():
    """Control: each side once, in any order."""
    s = ul.solve(ul.Problem(SQUARE, -1, 0), **SIZES)
    for sides in ([4], [-1], [1, 1]):
        with sentences.raises(ul.InputError, "sides: "):
            s.force(sides=sides)
    assert s.force(sides=[2, 1]) == s.force(sides=[1, 2])
