"""Problems from files: what they mean, sides that carry no contact, and what is refused, in which words."""

import re
from fractions import Fraction

import numpy as np
import pytest
import sentences
import sympy
from conftest import DATA

import unilateral as ul
from unilateral.bounds import source
from unilateral.bounds.source_ancestors import TARGET_REMAINDER_RATIO
from unilateral.discrete.condensed import discretise
from unilateral.errors import InputError
from unilateral.formulas.expression import rational_expression as exact
from unilateral.formulas.formula import compile_numpy
from unilateral.geometry import partition as partitions
from unilateral.geometry.mesh import make_unstructured_mesh
from unilateral.geometry.polygon import square
from unilateral.geometry.structured import make_structured_mesh
from unilateral.problems import problem_file
from unilateral.solvers.dispatch import run_algorithm
from unilateral.solvers.stop import Stop

PROBLEMS = sorted((DATA / "problems").glob("*.yaml"))


@pytest.fixture
def write_problem(problem_file_of):
    return lambda **fields: problem_file_of(**{"f": "x - y", "g": 0} | fields)


def test_the_ten_problems_can_be_loaded():
    assert len(PROBLEMS) == 10
    loaded = [problem_file.load_problem(str(file)) for file in PROBLEMS]
    convex = [np.all(problem.polygon.angles < np.pi) for problem in loaded]
    assert convex.count(False) >= 2
    assert any(problem.free_sides for problem in loaded)
    assert any(problem.polygon.angles.min() < 0.06 for problem in loaded)


def test_f_and_g_are_the_formulas(write_problem):
    problem = problem_file.load_problem(
        write_problem(
            polygon="[[0, 0], [2, 0], [1/2, 3/2]]",
            f="sin(x)*y + pos(x - 1, 1)",
            g='["x*(x - 2)", "y*exp(x - 2)", "(1 - 2*x)*(x - y)*x + 3*exp(-3/2)*x"]',
        )
    )
    x, y = np.random.default_rng(1).random((2, 20))
    expected = np.sin(x) * y + np.maximum(x - 1, 0)
    assert compile_numpy([problem.f], "xy")(x, y)[0] == pytest.approx(expected, rel=1e-14)
    side = np.array([0, 1, 1, 2])
    s = np.array([0.3, 0.2, 0.9, 1.0])
    x, y = problem.polygon.at(side, s).T
    by_side = [x * (x - 2), y * np.exp(x - 2), (1 - 2 * x) * (x - y) * x + 3 * np.exp(-1.5) * x]
    along = problem.polygon.starts[side] + s
    enclosed_obstacle = problem.enclosed_obstacle
    g, slope = enclosed_obstacle.evaluate(enclosed_obstacle.find_pieces(along), along)
    assert g == pytest.approx([by_side[i][k] for k, i in enumerate(side)], rel=1e-8)
    step = 1e-5
    before = enclosed_obstacle.evaluate(enclosed_obstacle.find_pieces(along + (-step)), along + (-step))[0]
    after = enclosed_obstacle.evaluate(enclosed_obstacle.find_pieces(along + step), along + step)[0]
    assert slope == pytest.approx((after - before) / (2 * step), rel=1e-6)


def test_jumps_of_f_are_where_it_has_them(write_problem):
    """Kinks are none: there f is enclosed by ever smaller pieces."""
    f = "pos(2*x + 2*y - 1, 0) + pos(1/4 - (x - 1)**2 - (y - 1/2)**2, 0) + pos(x - 1/3, 1)"
    line, circle = sorted(
        problem_file.load_problem(write_problem(f=f)).source.jumps.values(), key=lambda kink: kink.radius
    )
    on_line = np.array([[0.1, 0.4], [0.5, 0.0]])
    on_circle = np.array([[0.5, 0.5], [1.0, 1.0]])
    assert line.signed_distances(on_line) == pytest.approx([0, 0], abs=1e-15)
    assert abs(line.signed_distances(np.array([[1.0, 1.0]]))) == pytest.approx([1.5 / np.sqrt(2)])
    assert circle.signed_distances(on_circle) == pytest.approx([0, 0], abs=1e-15)


def test_data_of_any_size_in_between_are_accepted(write_problem):
    for size in ("1e-139", "1e139"):
        problem = problem_file.load_problem(write_problem(f=f"{size}*x", g=f"{size}*y"))
        assert problem.range_of_f[1] == pytest.approx(float(size))
    assert problem_file.load_problem(write_problem(f="pos(x - 2, 1)", g="0")).range_of_f == pytest.approx(
        (0, 0), abs=1e-290
    )


@pytest.mark.parametrize(
    "zero", ["pos(-x, 1/2)", "-1*pos(-x, 1/2)*y", "pos(-x, 9/20)", "x*pos(-x, 1/2)", "0"]
)
def test_what_is_0_is_accepted_though_enclosures_of_it_are_larger(write_problem, zero):
    """The root of 5e-324, which intervals make of 0, is 2e-162. Control: what is as small, but not 0."""
    for tiny in (zero, f"{zero} + 1e-150*y*(1 - y)"):
        for fields, where in (
            ({"f": tiny}, "field f"),
            ({"g": f'[0, 0, 0, "{tiny}"]'}, "field g"),
            ({"free_sides": "[3]", "q": tiny, "g": "[-1, -1, -1, null]"}, "field q"),
            ({"u": f"{{0: 0, 1: 0, 2: 0, 3: '{tiny}'}}", "g": "[null, null, null, null]"}, "field u"),
        ):
            if tiny == zero:
                problem_file.load_problem(write_problem(**fields))
            else:
                with sentences.raises(InputError, where):
                    problem_file.load_problem(write_problem(**fields))


def test_loads_and_means_see_the_kinks(write_problem):
    """The integral of f over Omega and the means of g, against their closed forms.

    The remainder that is wanted is TARGET_REMAINDER_RATIO h times the deviation of f, which is 0.43.
    """
    problem = problem_file.load_problem(write_problem(f="pos(x - 0.3, 1)*exp(y)", g="pos(x - 1/3, 3/2)"))
    enclosure = source.enclose_function(make_structured_mesh(square(), 1 / 4), problem.source)
    exact = 0.7**2 / 2 * (np.e - 1)
    assert enclosure.moments().sum() == pytest.approx(exact, abs=enclosure.remainder_norm)
    assert enclosure.remainder_norm <= TARGET_REMAINDER_RATIO / 4 * 0.44
    means = problem.enclosed_obstacle.means(partitions.make_uniform_partition(square(), 1 / 2).points)
    exact = 2 * np.diff(0.4 * np.maximum(np.array([0, 1 / 2, 1]) - 1 / 3, 0) ** 2.5)
    assert means[:2] == pytest.approx(exact, rel=1e-9)
    assert means[4:6] == pytest.approx(exact[::-1], rel=1e-9)


IDLE = {"f": "1 + x*y", "g": '["x**2/2", "1/2 + y", "x + 1/2", "y/2"]'}


def test_a_side_below_the_source_is_idle(write_problem):
    """sup g < inf f there: f >= 1, and g < 1 on sides 0 and 3 only."""
    problem = problem_file.load_problem(write_problem(**IDLE))
    assert problem.range_of_f[0] == pytest.approx(1, abs=1e-2)
    assert problem.idle_sides() == (0, 3)
    g = IDLE["g"].replace('"y/2"', "null")
    free = problem_file.load_problem(write_problem(f=IDLE["f"], g=g, free_sides="[3]"))
    assert free.idle_sides() == (0,)


def test_the_lower_bound_of_u_is_one_whatever_is_rounded(write_problem):
    """inf f / c, in rational arithmetic, for numbers of which no quotient is exact."""
    above = []
    for number in range(1, 40):
        c = Fraction(number, 7)
        problem = problem_file.load_problem(write_problem(f=f"{number + 13}/11", g="-9", c=f"{number}/7"))
        min_range_of_f = problem.range_of_f[0]
        assert Fraction(problem.u_lower_bound) <= Fraction(min_range_of_f) / c
        above.append(Fraction(min_range_of_f / float(c)) > Fraction(min_range_of_f) / c)
    assert any(above)  # control: without what is subtracted


def test_an_idle_side_carries_no_contact_and_an_undecided_one_is_left_in(write_problem):
    """u >= inf f, seen on a solution whose sides all have multipliers; control: side 1 has contact."""
    problem = problem_file.load_problem(write_problem(**IDLE))
    cells = partitions.make_uniform_partition(square(), 1 / 8)
    discrete = discretise(problem, make_structured_mesh(square(), 1 / 16), cells)
    lambda_H = run_algorithm(discrete.spaces.operator, discrete.offset, 1e-8, Stop(), None).lambda_H
    idle = np.isin(cells.side, problem.idle_sides())
    assert np.all(lambda_H[idle] == 0)
    assert np.max(lambda_H[~idle]) > 0.1
    touching = problem_file.load_problem(write_problem(f="1", g="1 - x*(1 - x)*y*(1 - y)"))
    assert touching.idle_sides() == ()


REFUSED = [
    (
        {"free_side": "[1]"},
        ": there is no field 'free_side' here; the fields are title, polygon, side_names, f, g, k, c,",
    ),
    ({"g": None}, ", field g: it is missing, and side 0 is neither free nor clamped; write one formula for"),
    ({"f": "x + z"}, ", field f: 'z' is unknown; known are x, y, pi"),
    ({"g": "[0, '1/(0', 0, 0]"}, r", field g\[1\]: '1/\(0' is not a formula in x, y"),
    ({"f": "true"}, ", field f: it is True; it has to be a formula in x and y"),
    ({"f": ".inf"}, ", field f: '.inf' is not a formula in x, y"),
    (
        {"polygon": "[[0, 0], [010, 0], [010, 010]]"},
        r", field polygon\[1\]: '010' is not a formula of numbers, such as 3, 0.05 or 1/3; write 10 for 010",
    ),
    ({"polygon": [[0, 0], [1, 0], [1, 1]] * 667}, ", field polygon: it has 2001 vertices; at most 1000 are"),
    ({"f": "1/(x - 1/3)"}, ", field f: it is not finite in the polygon"),
    ({"f": "exp(1000*x)"}, ", field f: it is not finite in the polygon"),
    ({"g": "cos(cosh(y))/y"}, ", field g: it is not finite on side 0, or no bound can be found"),
    ({"g": "1/(x - 1/3)"}, ", field g: it is not finite on side 0"),
    ({"g": "pos(x - 1/y, 1)"}, ", field g, on side 0: it is not a finite real function"),
    ({"f": "1e150*x"}, r", field f: it is as large as 1e\+150 in the polygon, and squares of err"),
    ({"f": "1e-165*cos(pi*x)"}, ", field f: it is as large as 1e-165 in"),
    ({"f": "1e-160*(3*x - 2)"}, ", field f: it is as large as 2e-160 in the polygon, and squares of errors"),
    (
        {"polygon": "[[0, 0], [1e75, 0], [1e75, 1e75], [0, 1e75]]", "f": "1e100*(1 + x/1e75)"},
        r", field f: it is as large as 2e\+100 in the polygon, and squares of errors on a polygon",
    ),
    ({"g": "1e141*x"}, r", field g: it is as large as 1e\+141 on side 0, and squares of errors"),
    ({"f": "pos(sin(1)**2*y + cos(1)**2*y - y + x - 1/2, 0)"}, r", field f: the argument of pos\("),
    (
        {"f": "sqrt(x)"},
        r", field f: sqrt\(x\) needs x > 0 in the polygon; write pos\(x, 1/2\), which is 0 elsewhere",
    ),
    ({"f": "sqrt(x*y)"}, r", field f: sqrt\(x\*y\) needs x\*y > 0 in the polygon$"),
    ({"f": "1 + (x - y)**(1/21)"}, r", field f: \(x - y\)\*\*\(1/21\) needs x - y > 0 in the polygon$"),
    ({"f": "x/sqrt(x**2 + y**2)"}, r", field f: 1/sqrt\(x\*\*2 \+ y\*\*2\) needs x\*\*2 \+ y\*\*2 > 0 in"),
    (
        {"f": "log(x + 1)"},
        r", field f: log is allowed for numbers only, such as log\(2\)",
    ),
    (
        {"g": "null"},
        ", field g: it is missing, and side 0 is neither free nor clamped; write one formula for",
    ),
    (
        {"g": "null", "free_sides": "[0, 1]", "u": "{3: 0}"},
        ", field g: it is missing, and side 2 is neither free nor clamped; write one formula for all sides",
    ),
    ({"u": "{3:0}"}, r", field u: the colon in '3:0' needs a blank after it; write \{3: 0\}"),
    ({"g": "sqrt(x)"}, r", field g: sqrt\(x\) needs x > 0 on side 0; a root is not Lipschitz"),
    (
        {"g": "[0, 'sqrt(y - 1/3)', 0, 0]"},
        r", field g: sqrt\(y - 1/3\) needs y - 1/3 > 0 on side 1; a root is",
    ),
    ({"g": "sqrt(1 + pos(x - 1/2, 1/2))"}, ", field g: on side 0 a power of pos is below 1"),
    ({"g": "pos(x - 1/2, 1/2)"}, ", field g: on side 0 a power of pos is below 1"),
    ({"f": "pos(x*y - 1/4, 1)"}, r"must be linear, or c - \(x - a\)\*\*2 - \(y - b\)\*\*2"),
    ({"f": "pos(sin(x), 1)"}, r", field f: the argument of pos\(sin\(x\), 1\) must be lin"),
    ({"g": "[0, 0]"}, ", field g: 2 formulas for 4 sides; give one for all, or one per"),
    (
        {"g": "[0, null, 0, 0]"},
        r", field g\[1\]: there is no formula, and side 1 is neither free nor clamped; write one, or",
    ),
    ({"f": "none"}, ", field f: 'none' is no formula; write 0 where there is none"),
    ({"f": "None"}, ", field f: 'None' is no formula; write 0 where there is none"),
    (
        {"g": "none"},
        ", field g: 'none' is no formula; in a list write null for a side that is named in free_",
    ),
    (
        {"g": "[none, 0, 0, 0]"},
        r", field g\[0\]: 'none' is no formula; in a list write null for a side that is named in free_sides",
    ),
    ({"free_sides": "[1]", "q": "nil"}, ", field q: 'nil' is no formula; write 0 where there is none, or in"),
    (
        {"g": "[0, 0, null, 0]", "free_sides": "[2, 3]"},
        r", field g\[3\]: side 3 is free; write null, or take it out of free_sides",
    ),
    ({"g": "[0, 0, 1, 0]"}, ", field g: it jumps at vertex 2, from 0 on side 1 to 1 on side 2"),
    ({"g": "[1 - x, 0, 0, 0]"}, ", field g: it jumps at vertex 0, from 0 on side 3"),
    ({"c": "0"}, ", field c: it is 0 and no side is clamped, so that u is not unique; clamp a side in"),
    (
        {"u": "{0: 0}", "free_sides": "[0]"},
        ", field free_sides: side 0 is clamped; remove it from free_sides",
    ),
    (
        {"u": "{0: 0}", "g": "[null, 1, 1, 1]"},
        r", field u: at vertex 0, \(0, 0\), u is 0 on side 0, which is clamped, but g is 1 on side 3; u >= g",
    ),
    (
        {"u": "{0: 0, 1: 1}", "g": "[null, null, -1, -1]"},
        ", field u: it jumps at vertex 1, from 0 on side 0 to 1 on side 1; it has to be continuous",
    ),
    ({"u": "0", "g": "0"}, ", field u: it is 0; it has to be a formula for each clamped side, by its number"),
    (
        {"u": "{0: 'pos(x - 1/2, 1/2)'}", "g": "-9"},
        r", field u\[0\]: on side 0 a power of pos is below 1; a Lip",
    ),
    ({"u": "{0: 1/y}", "g": "-9"}, ", field u: it is not finite on side 0, or no bound can be found"),
    ({"u": "{0: 0}", "g": "[0, 0, 0, 0]"}, r", field g\[0\]: side 0 is clamped; write null, or take it out"),
    ({"k": "0"}, ", field k: it is 0; it has to be a positive number, between 1e-30 and 1e"),
    ({"c": "-1/3"}, ", field c: it is -1/3; it has to be a positive number"),
    ({"c": "x"}, ", field c: 'x' is unknown; known are pi"),
    ({"q": "x"}, ", field q: no side is free; name the sides with a given flux in free_sides"),
    (
        {"free_sides": "[1]", "q": "[null, 1, x, null]"},
        r", field q\[2\]: side 2 is not free; write null, or name it in free_sides",
    ),
    ({"free_sides": "[1]", "q": "[1, 2]"}, ", field q: 2 formulas for 4 sides; give one for all, or one per"),
    ({"free_sides": "[1]", "q": "1/(y - 1/3)"}, ", field q: it is not finite on side 1, or no bound can be"),
    ({"free_sides": "[0]", "q": "pos(x, -1/4)"}, ", field q: "),
    (
        {"free_sides": "[1]", "q": "sqrt(y)"},
        r", field q: sqrt\(y\) needs y > 0 on side 1; write pos\(y, 1/2\), which",
    ),
    ({"free_sides": "[1]", "q": "log(y + 1)"}, ", field q: log is allowed for numbers only"),
    (
        {"free_sides": "[1]", "q": "[null, z, null, null]"},
        r", field q\[1\]: 'z' is unknown; known are x, y, pi",
    ),
    ({"free_sides": "[1]", "q": "true"}, ", field q: it is True; it has to be the flux k du/dn, one formula"),
    (
        {"free_sides": "[1]", "q": "1e150*y"},
        r", field q: it is as large as 1e\+150 on side 1, and squares",
    ),
    ({"polygon": "[[0, 0], [0, 1], [1, 0]]"}, ", field polygon: .* clockwise; list its vertices anticlock"),
    (
        {"polygon": "[[0, 0], [1, 0]]"},
        r", field polygon: it is \[\[0, 0\], \[1, 0\]\]; it has to be the vert",
    ),
    (
        {"polygon": "[[0, 0], [1, 0], [1, 1, 1]]"},
        r", field polygon\[2\]: it is \[1, 1, 1\]; it has to be a p",
    ),
    ({"polygon": "[[0, 0], [1, 0], [a, 1]]"}, r", field polygon\[2\]: 'a' is unknown; known are pi"),
    ({"polygon": "[[0, 0], [1e400, 0], [0, 1]]"}, r", field polygon\[1\]: '1e400' has a"),
]
NO_SIDES = {
    "4": "not 4",
    "-1": "not -1",
    "01": "not '01'; a side is a whole number",
    "3/2": "not '3/2'; a side is a whole number",
    "left": "not 'left'; a side is a whole number",
    "9" * 30: "not '999",
}
OF_SIDES = [
    ({field: text.format(side), "g": "-9"}, f", field {field}: the polygon has the sides 0 to 3, {no_side}")
    for field, text in {"free_sides": "[0, {}]", "u": "{{0: 0, {}: 0}}"}.items()
    for side, no_side in NO_SIDES.items()
]
OF_SIDES += [
    ({"free_sides": "[1, 1]"}, ", field free_sides: side 1 is given twice; give it once"),
    ({"u": "{1: 0, 1: 1}"}, ": '1' is given twice, again in line 4; give it once"),
    ({"u": "{1: 0, +1: 1}"}, ", field u: side 1 is given twice; give it once"),
    ({"u": "{1: 0}", "free_sides": "[0, 1]"}, ", field free_sides: side 1 is clamped; remove it from"),
    (
        {"u": "{1: 0}", "g": "[0, 0, 0, 0]"},
        r", field g\[1\]: side 1 is clamped; write null, or take it out of u",
    ),
    (
        {"u": "{1: 0}", "g": "-9", "q": "[null, 0, null, null]"},
        r", field q\[1\]: side 1 is clamped; write null, or take it out of u",
    ),
    (
        {"u": "{0: none}"},
        r", field u\[0\]: 'none' is no formula; write the value of u, such as 0, or leave the",
    ),
    ({"u": "{0: [0]}"}, r", field u\[0\]: it is \[0\]; it has to be a formula in x and y, a table"),
    ({"u": "{0: x*(1 - x)*1e-300}", "g": "0"}, ", field u: it is as large as .*e-301 on side 0, and squares"),
    ({"u": "{0: 0}", "g": "-1e-200"}, ", field g: it is as large as 1e-200 on side 1, and squares of errors"),
]


@pytest.mark.parametrize(("fields", "message"), REFUSED + OF_SIDES, ids=lambda value: str(value)[:60])
def test_a_bad_file_is_refused_in_one_sentence(write_problem, fields, message):
    """With the file and the field; without the fault it is accepted (the fixture's other fields)."""
    file = write_problem(**fields)
    with pytest.raises(InputError) as refusal:
        problem_file.load_problem(file)
    assert re.fullmatch(f"{file}.*{message}.*", str(refusal.value))
    problem_file.load_problem(write_problem())


def test_a_side_may_be_free_or_clamped_and_data_of_one_may_be_small(write_problem):
    """Controls of what is refused: what is largest counts, not each side alone."""
    problem = problem_file.load_problem(write_problem(free_sides="[+1]", u="{3: null, +0: 1e-300*x}", g="-9"))
    assert (problem.free_sides, problem.clamped_sides) == ((1,), (0, 3))


@pytest.mark.parametrize("g", [None, "null", "[null, null, null, null]"])
def test_where_no_side_has_an_obstacle_g_may_be_left_out(write_problem, run, g):
    """u = 1 + x on clamped sides, with du/dn = 0 on the others, has f = 0: u_h is u, for it is linear."""
    file = write_problem(f=0, g=g, free_sides="[0, 2]", u="{1: 2, 3: 1}", c="0")
    problem = problem_file.load_problem(file)
    assert problem.contact_sides == ()
    s = ul.solve(problem, h=1 / 4, H=1 / 2)
    assert s.u == pytest.approx(1 + s.mesh.points[:, 0], abs=1e-12)
    code, printed, _ = run("solve", file, "--h", "1/4", "--H", "1/2")
    assert code == 0
    assert "no side carries contact, so the problem is linear" in printed


def test_vertices_are_counted_before_they_are_read(write_problem, monkeypatch):
    """Control: of a polygon that is not too large every coordinate is read."""
    read = []
    monkeypatch.setattr(problem_file, "parse_number", lambda text, _: read.append(text) or exact(int(text)))
    with sentences.raises(InputError):
        problem_file.load_problem(write_problem(polygon=[[0, 0]] * 1001))
    assert read == []
    problem_file.load_problem(write_problem())
    assert len(read) == 8


def test_numbers_are_read_exactly(write_problem):
    """20 digits, which no float has, and 1_000, which is what it looks like."""
    problem = problem_file.load_problem(write_problem(f="0.12345678901234567891", g="1_000"))
    assert problem.f.rational == Fraction(12345678901234567891, 10**20)
    assert [g.rational for g in problem.g] == [1000] * 4


def test_a_jump_at_a_free_side_is_harmless(write_problem):
    problem = problem_file.load_problem(write_problem(g='["1 - x", null, 0, null]', free_sides="[1, 3]"))
    assert problem.enclosed_obstacle.range(0) == pytest.approx((0, 1))
    assert problem.enclosed_obstacle.range(1) == (-np.inf, -np.inf)


@pytest.mark.parametrize("content", ["", "- 1\n"])
def test_files_that_declare_nothing_are_refused(tmp_path, content):
    (tmp_path / "own.yaml").write_text(content)
    with sentences.raises(InputError):
        problem_file.is_problem_file(str(tmp_path / "own.yaml"))


def test_a_problem_is_told_from_a_case_by_its_fields(write_problem, tmp_path):
    case = tmp_path / "case.yaml"
    case.write_text("title: a case\npolygons: any\nu: []\n")
    assert problem_file.is_problem_file(write_problem())
    assert problem_file.is_problem_file(write_problem(polygon=None, g=None))
    assert not problem_file.is_problem_file(str(case))
    assert not problem_file.is_problem_file("natural")


def test_terms_that_cancel_are_no_reason_to_refuse(write_problem):
    """(x - 20)^12, expanded, near x = 20: its terms are as large as 924 * 20^12, its values 1."""
    twelfth = sympy.expand((sympy.Symbol("x") - 20) ** 12)
    problem = problem_file.load_problem(
        write_problem(polygon="[[20, 0], [21, 0], [21, 1], [20, 1]]", f=twelfth, g=0)
    )
    assert problem.range_of_f[0] <= 0 <= 1 <= problem.range_of_f[1] < np.inf
    assert (
        0
        < source.enclose_function(
            make_unstructured_mesh(problem.polygon, 1 / 4), problem.source
        ).remainder_norm
        < 1e7
    )


@pytest.mark.parametrize(
    ("g", "pieces"),
    [
        ("pos(1/4-(x-1/2)**2-y**2,1)", 100),
        ("x*pos(x-y-1/2,1)", 100),
        ("exp(-3000*((x-3/10)**2+y**2))", 178),
        ('["-1+4*exp(-((x-31415/100000)*10**6)**2)", -1, -1, -1]', 150),
    ],
)
def test_g_with_kinks_or_a_narrow_peak_needs_few_pieces(write_problem, g, pieces):
    """To 1e-10 and better. The smooth one takes 100^(1/8) times the pieces that 1e-8 would take, of degree 7.

    In the last one the rounding of x is magnified by 10^6: EPS * 10^6 and some ten operations. Sides on which
    g is as small as 1e-117 are not counted: they have more pieces, for g is known as well relative to that.
    """
    enclosed_obstacle = problem_file.load_problem(write_problem(f=-1, g=g)).enclosed_obstacle
    counted = [side for side in range(4) if np.abs(enclosed_obstacle.range(side)).max() > 1e-100]
    assert np.count_nonzero(np.isin(enclosed_obstacle.side, counted)) <= pieces
    assert enclosed_obstacle.remainder.max() <= (1e-7 if "10**6" in g else 1e-10)


@pytest.mark.parametrize(
    ("g", "peak"),
    [
        ('["exp(-1e8*(x - 0.5123)**2)", "-10*y", "-10", "-10*y"]', 0.5123),
        ('["exp(-1e8*(x - 0.5123)**2)", "-1e10*y", "-1e10", "-1e10*y"]', 0.5123),
        ('["exp(-1e12*(x - 0.3123)**2) - 1000*pos(x - 1/2, 1)", "-500", "-500", "-500*y"]', 0.3123),
    ],
)
def test_a_peak_of_g_is_not_hidden_by_values_that_u_cannot_reach(write_problem, g, peak):
    """u >= -1 = inf f: what g is below that, on this side or another one, says nothing of its size."""
    enclosed_obstacle = problem_file.load_problem(write_problem(f=-1, g=g)).enclosed_obstacle
    near = (enclosed_obstacle.points[:-1] <= peak) & (enclosed_obstacle.points[1:] >= peak)
    assert enclosed_obstacle.upper[near].max() == pytest.approx(1, abs=1e-3)
    assert enclosed_obstacle.remainder[near].max() <= 1e-8
