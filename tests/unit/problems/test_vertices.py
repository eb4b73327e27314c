"""Data at the vertices: what is no trace of a function in H1 is refused, whatever numbers stand elsewhere.

No function in H^{1/2} of a curve jumps, and traces of H1 are such functions. So u on two clamped sides in a
row, or g on two with contact, has to be the same at their vertex, and u >= g where one of each meets. Numbers
that differ there by rounding only count as one, and the bounds then take that away.
"""

import math
from dataclasses import dataclass

import numpy as np
import pytest
import sentences

import unilateral as ul
from unilateral.bounds import feasible
from unilateral.bounds.constraint import build_constraint
from unilateral.discrete.problem_data import problem_form
from unilateral.fem.form import H1
from unilateral.formulas.expression import ZERO
from unilateral.formulas.formula import parse_formula
from unilateral.formulas.taylor import EPS
from unilateral.geometry.polygon import Polygon, square
from unilateral.geometry.structured import make_structured_mesh
from unilateral.problems import build, obstacle_and_flux
from unilateral.problems.data_checks import check_data
from unilateral.problems.nodal import NodalTrace
from unilateral.problems.problem import Problem

DRAWS = 300
ALONG = ("x", "y", "(1 - x)", "(1 - y)")
"""The arc length on the sides of the unit square."""
OPERATIONS = 64
"""More than the operations, each rounded by EPS at most, that a side's formula has, and enclosures double."""
CLAMPED = "clamped"
CONTACT = "contact"
FREE = "free"
REFUSED = r"it jumps at vertex|u >= g has to hold there"
UNIT = square()
MESH = make_structured_mesh(UNIT, 1 / 4)


@dataclass
class Drawn:
    """What each side of the unit square is, numbers at its ends (4, 2), and whether they fit together.

    `wrong` is None if they do, and else by how much they do not; `largest` is the largest number.
    """

    kinds: list[str]
    ends: np.ndarray
    wrong: float | None
    kc: tuple[float, float]

    @property
    def largest(self):
        return max(np.abs(self.ends[i]).max() for i in range(4) if self.kinds[i] != FREE)


def draw_problem(seed, retained, operations=OPERATIONS):
    """Numbers of 1e-12 to 1e12 at the vertices. At one of them the two that meet differ.

    That is by a hundredth of what counts as rounding, or by ten times as much and up to everything. What
    counts is the part `kept` of the larger of both, and the rounding of the two formulas.
    """
    rng = np.random.default_rng(seed)
    while True:
        kinds = [str(kind) for kind in rng.choice([CLAMPED, CONTACT, FREE], 4, p=[0.4, 0.4, 0.2])]
        meet = [i for i in range(4) if FREE not in (kinds[i - 1], kinds[i])]
        if meet:
            break
    position = rng.choice([-1.0, 1.0], 4) * 10 ** rng.uniform(-12, 12, 4) * (rng.random(4) < 0.9)
    ends = np.stack([position, np.roll(position, -1)], axis=1)
    for i in range(4):  # u may be above g by any amount
        for second in (i - 1, (i + 1) % 4):
            if kinds[i] == CLAMPED and kinds[second] == CONTACT and rng.random() < 0.3:
                ends[second, 1 if second in (i - 1, i + 3) else 0] -= 10 ** rng.uniform(-12, 12)
    vertex = int(rng.choice(meet))
    before = ends[vertex - 1]
    after = ends[vertex]
    sizes = np.abs([before, after])
    rounding = operations * EPS * sizes.sum()
    fits = rng.random() < 0.5
    wrong = None
    if fits:
        after[0] = before[1] * (1 + 1e-2 * retained * rng.choice([-1, 1]))
    else:
        wrong = 10 ** rng.uniform(0, 6) * 10 * (retained * max(abs(before[1]), 1e-12) + rounding)
        lower_g = kinds[vertex] == CONTACT or kinds[vertex] == kinds[vertex - 1]
        after[0] = before[1] + (wrong if lower_g else -wrong)
        wrong *= 1 - retained
    return Drawn(kinds, ends, wrong, (1.0, 1.0) if rng.random() < 0.5 else tuple(10 ** rng.uniform(-3, 3, 2)))


def formula(i, start, end):
    text = f"({float(start)!r}) + (({float(end)!r}) - ({float(start)!r}))*{ALONG[i]}"
    return parse_formula(text, ("x", "y"), "drawn")


def function(i, start, end):
    return lambda x, y: start + (end - start) * (x, y, 1 - x, 1 - y)[i]


def trace(i, start, end):
    t = np.array([0.0, 0.25, 0.5, 1.0])
    return NodalTrace(t, np.append(start + (end - start) * t[:-1], end))


def check_problem(problem, data):
    """The problem, checked as those of users are."""
    sides = {i: data(i, *problem.ends[i]) for i in range(4) if problem.kinds[i] != FREE}
    free = tuple(i for i in range(4) if problem.kinds[i] == FREE)
    clamped = tuple(i for i in range(4) if problem.kinds[i] == CLAMPED)
    g = [sides.get(i, ZERO) for i in range(4)]
    k = parse_formula(repr(float(problem.kc[0])), (), "drawn")
    c = parse_formula(repr(float(problem.kc[1])), (), "drawn")
    posed = Problem("drawn", UNIT, ZERO, tuple(g), free, k, c, clamped_sides=clamped)
    if data is function:
        return build.put_on_mesh(posed, MESH)
    check_data(posed, "drawn")
    return posed


def make_constraint(problem):
    """The constraint on MESH."""
    return build_constraint(problem.enclosed_obstacle, MESH, problem_form(problem, MESH))


def missing_of(g):
    """What u_D and g themselves are short of, without a flux."""
    v = np.where(np.isfinite(g.p_at_unknowns), g.p_at_unknowns, 0.0)
    return feasible.bound_shortfall(g, H1, v, g.clamped_edges, np.zeros((len(g.unknowns), 2)))


@pytest.mark.parametrize(("data", "draws"), [(formula, DRAWS), (trace, DRAWS // 3)])
def test_what_is_no_trace_is_refused_and_what_fits_is_lifted(data, draws):
    """As they were drawn. Control: in units of the largest number on all sides many jumps are rounding."""
    passed_before = refused = 0
    for seed in range(draws):
        problem = draw_problem(seed, obstacle_and_flux.VERTEX_JUMP_TOLERANCE)
        if problem.wrong is not None:
            with pytest.raises(ul.InputError, match=REFUSED):
                check_problem(problem, data)
            refused += 1
            passed_before += problem.wrong < obstacle_and_flux.VERTEX_JUMP_TOLERANCE * problem.largest
            continue
        g = make_constraint(check_problem(problem, data))
        assert not np.any(g.clamped_edges & g.has_jump), seed
        assert math.isfinite(missing_of(g).extension_norm), seed
    assert draws // 3 < refused < 2 * draws // 3
    assert passed_before > draws // 10


def test_functions_are_compared_by_the_digits_that_they_keep():
    """As above: functions that fit have one value at a vertex, and are lifted."""
    for seed in range(DRAWS // 2):
        problem = draw_problem(seed, build.FUNCTION_ACCURACY)
        if problem.wrong is not None:
            with pytest.raises(ul.InputError, match=REFUSED):
                check_problem(problem, function)
            continue
        g = make_constraint(check_problem(problem, function))
        assert not np.any(g.clamped_edges & g.has_jump), seed
        assert math.isfinite(missing_of(g).extension_norm), seed


NEAR_0 = [
    ("sin(pi*x)", 0, lambda x, y: np.sin(np.pi * x), 0),
    ("x - 1e8 + 1e8 - 3/10", "7/10", lambda x, y: x - 1e8 + 1e8 - 0.3, 0.7),
    ("0.1*x - 0.1", "1.4e-17", lambda x, y: 0.1 * x - 0.1, 1.4e-17),
    ("1e6 - pos(1e12 - x**2, 1/2)", "1e6 - pos(1e12 - 1, 1/2)", None, None),
]


@pytest.mark.parametrize(("remaining", "right", "f_left", "f_right"), NEAR_0)
def test_numbers_that_cancel_at_a_vertex_are_rounded_like_their_terms(remaining, right, f_left, f_right):
    """At (1, 0); sin(pi) is 1.2e-16 to NumPy. Control: ten times the rounding more is a jump."""
    remaining_data = {"f": 0, "free_sides": [2, 3]}
    if "pos" not in remaining:
        ul.Problem(square(), g=[remaining, right, None, None], **remaining_data)
        ul.Problem(square(), u={0: remaining, 1: right}, g=[None] * 4, **remaining_data)
        with sentences.raises(ul.InputError):
            ul.Problem(square(), g=[remaining, f"{right} + 1e-6", None, None], **remaining_data)
    if f_left:
        ul.Problem(MESH, g=[f_left, f_right, None, None], **remaining_data)
        with sentences.raises(ul.InputError):
            ul.Problem(MESH, g=[f_left, f_right + 1e-6, None, None], **remaining_data)


@pytest.mark.parametrize("n", [4, 300])
def test_arrays_of_what_cancels_at_a_vertex_are_accepted(n):
    """np.sin(np.pi) is 1.2e-16, on meshes on which the next number is 1 or 1/100."""
    strip = Polygon(np.array([[0, 0], [1, 0], [1, 1 / n], [0, 1 / n]]), "strip")
    mesh = ul.mesh(*row_of_squares(n), polygon=strip)
    wave = np.sin(np.pi * mesh.points[:, 0])
    assert 0 < abs(wave[mesh.points[:, 0] == 1]).max() < 1e-15
    ul.Problem(mesh, 0, [wave, 0, None, None], free_sides=[2, 3])
    with sentences.raises(ul.InputError):
        ul.Problem(mesh, 0, [wave, 1e-12, None, None], free_sides=[2, 3])


def row_of_squares(n):
    """n squares in a row, each cut in two."""
    x = np.linspace(0, 1, n + 1)
    points = np.concatenate([np.stack([x, 0 * x], axis=1), np.stack([x, 0 * x + 1 / n], axis=1)])
    i = np.arange(n)
    lower = np.stack([i, i + 1, i + n + 2], axis=1)
    upper = np.stack([i, i + n + 2, i + n + 1], axis=1)
    return points, np.concatenate([lower, upper])


X, Y = MESH.points.T
ELSEWHERE = [
    ({"g": [-1e9, None, None, None]}, {2: "x + 5e-4", 3: 0}, "field u: it jumps at vertex 3"),
    ({"g": [-1e12, None, None, None]}, {2: "10*x + 1/2", 3: 0}, "field u: it jumps at vertex 3"),
    ({"g": [-1e9, None, None, None]}, {2: X + 5e-4, 3: 0 * X}, "field u: it jumps at vertex 3"),
    ({"g": [-1e9, None, None, None]}, {2: lambda x, y: x + 5e-4, 3: 0}, "field u: it jumps at vertex 3"),
    ({"g": [-1e12, None, 0, None]}, {3: -0.4}, "field u: at vertex 3"),
    ({"g": [0, None, 5e-4, 0], "free_sides": [1]}, {}, "field g: it jumps at vertex 3"),
    ({"g": [-1e12, -1e12, 0, 5e-4], "free_sides": []}, {}, "field g: it jumps at vertex"),
]


@pytest.mark.parametrize("c", [0, 1])
@pytest.mark.parametrize(("fields", "u", "message"), ELSEWHERE)
def test_a_large_number_on_another_side_hides_no_jump(fields, u, message, c):
    if u or c:
        with pytest.raises(ul.InputError, match=message):
            ul.Problem(MESH, 0, **{"free_sides": [1]} | fields, u=u, c=c)


def test_numbers_that_differ_are_told_apart():
    """1e9 and 1e9 + 1/100 agree in 10 digits, so 12 are written. Control: 0 and 1 have one."""
    for g, report in (([1e9, 1e9 + 0.01, None, None], "from 1000000000 on side 0 to 1000000000.01 on side 1"),
                    ([0, 1, None, None], "from 0 on side 0 to 1 on side 1")):  # fmt: skip
        with sentences.raises(ul.InputError, report):
            ul.Problem(square(), -1, g, free_sides=[2, 3])
    with sentences.raises(ul.InputError):
        ul.Problem(square(), -1, [1e9 + 0.01, None, None, None], free_sides=[1, 2], u={3: 1e9})


@pytest.mark.parametrize("c", [0, 1])
def test_no_jump_that_is_left_over_has_a_bound(c):
    """What `check_data` refuses, unchecked. Control: u_D above g at a vertex, and one that fits, have one."""
    for u, finite in (("x + 5e-4", False), ("x", True)):
        g = [parse_formula(text, ("x", "y"), "drawn") for text in ("-1", "0", u, "0")]
        problem = Problem(
            "unchecked",
            UNIT,
            parse_formula("-1", (), "drawn"),
            tuple(g),
            (1,),
            c=parse_formula(str(c), (), "drawn"),
            clamped_sides=(2, 3),
        )
        s = ul.solve(problem, h=1 / 8, H=1 / 4)
        assert math.isfinite(s.bounds.u) == math.isfinite(s.sharp_bounds.u) == finite
        assert math.isfinite(s.forces().whole.upper) == finite


STEEP = "tanh({}*(y - 1))"
"""On side 1 of the square; it is 0 at (1, 1), but there y is rounded by 1e-16."""


@pytest.mark.parametrize(
    ("slope", "u", "finite"),
    [("1e30", "1", False), ("1e30", "0", False), ("1e15", "1/2", False), ("1e5", "0", True)],
)
def test_no_bound_is_finite_where_rounding_hides_a_jump(slope, u, finite):
    """u = 1 at the vertex is 1 off, which no u in H^1 is. Control: a slope of 1e5 leaves enough digits."""
    clamped_values = {1: STEEP.format(slope), 2: u}
    s = ul.solve(ul.Problem(UNIT, 0, [-9, None, None, -9], u=clamped_values), h=1 / 4, H=1 / 2)
    assert math.isfinite(s.bounds.u) == math.isfinite(s.bounds.multiplier) == finite
    assert ("guaranteed" in repr(s.bounds)) == finite


def test_a_steep_u_that_is_above_g_has_a_bound():
    """Whatever u is at (1, 1) it is above g there. Control: not if g is one of its values."""
    for g, finite in ((-9, True), ("-1/2", False)):
        problem = ul.Problem(UNIT, 0, [-9, None, g, None], [3], u={1: STEEP.format("1e15")})
        s = ul.solve(problem, h=1 / 4, H=1 / 2)
        assert math.isfinite(s.bounds.u) == finite


@pytest.mark.parametrize("c", [0, 1])
@pytest.mark.parametrize("minimum", [-1, -1e9, -1e12])
def test_a_bound_is_above_the_error_and_what_was_taken_for_rounding(minimum, c):
    """u = 1 + x, but given as 1 + 5e-13 at x = 0: in L2 alone that is more than 1e-13 from u."""
    problem = ul.Problem(
        UNIT,
        c if c == 0 else "1 + x",
        [minimum, None, None, None],
        [1],
        q=1,
        u={2: "1 + x", 3: 1 + 5e-13},
        c=c,
    )
    s = ul.solve(problem, h=1 / 8, H=1 / 4)
    error = np.abs(s.u - 1 - s.mesh.points[:, 0]).max()
    assert max(error, 1e-13) <= s.bounds.u <= 1e-9
    assert s.bounds.unknown < s.bounds.u


def entry(rng, kind):
    """The obstacle -1 in one of the ways in which it can be given."""
    ways = [-1, -1.0, "-1", lambda x, y: -1.0 + 0 * x, np.full(MESH.n_nodes, -1.0)]
    return ways[rng.integers(len(ways))] if kind else None


def test_no_obstacle_is_dropped():
    """300 lists of g for random kinds of sides: each entry is kept, or the list is refused by the side.

    An entry belongs to each side with contact, and to no other one.
    """
    rng = np.random.default_rng(11)
    refused = 0
    for _ in range(DRAWS):
        kinds = rng.choice([CLAMPED, CONTACT, FREE], size=4).tolist()
        obstacle_given = [kind == CONTACT for kind in kinds]
        wrong = int(rng.integers(4)) if rng.random() < 0.5 else None
        if wrong is not None:
            obstacle_given[wrong] = not obstacle_given[wrong]
        g = [entry(rng, has_obstacle) for has_obstacle in obstacle_given]
        sides = {kind: [i for i in range(4) if kinds[i] == kind] for kind in (CLAMPED, CONTACT, FREE)}
        options = {"free_sides": sides[FREE], "u": dict.fromkeys(sides[CLAMPED], 0.0)}
        if wrong is None:
            problem = ul.Problem(MESH, -1, g, **options)
            assert [*problem.free_sides] == sides[FREE]
            for side in sides[CONTACT]:
                assert value_of_g(problem, side) == -1
        else:
            refused += 1
            with pytest.raises(ul.InputError, match=rf"g\[{wrong}\]: .*side {wrong} is "):
                ul.Problem(MESH, -1, g, **options)
    assert 100 < refused < 200


def value_of_g(problem, side):
    """g at the start of a side, whichever way it was given."""
    g = problem.g[side]
    return g.values[0] if isinstance(g, NodalTrace) else float(g.rational)
