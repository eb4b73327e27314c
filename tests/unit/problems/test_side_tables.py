"""g, u and q as tables along a side: what they mean, what they cost, and which are refused in which words."""

from fractions import Fraction
from math import isqrt

import numpy as np
import pytest
import sentences

import unilateral as ul
from unilateral.errors import InputError
from unilateral.formulas.taylor import affine_model, monomial_basis
from unilateral.problems.side_tables import TableRows, make_table

SQUARE = [(0, 0), (1, 0), (1, 1), (0, 1)]
EXACTLY = ul.Stop(tolerance=1e-10)
SIZES = {"h": 1 / 16, "H": 1 / 8, "stop": EXACTLY}
ROWS = (np.array([0.0, 0.25, 0.6, 1.0]), np.array([0.0, 0.1, -0.05, 0.0]))
FORMULA = "2*x/5 - (2/5 + 3/7)*pos(x - 1/4, 1) + (3/7 + 1/8)*pos(x - 3/5, 1)"
"""The same broken line: its slopes are 2/5, -3/7 and 1/8."""


def assert_same_solution(problem, expected):
    """Both stop at 1e-10, so that bounds agree to about as many digits."""
    s = ul.solve(problem, **SIZES)
    t = ul.solve(expected, **SIZES)
    np.testing.assert_allclose(s.u, t.u, rtol=0, atol=1e-9)
    assert s.bounds.u == pytest.approx(t.bounds.u, rel=1e-8)
    assert s.bounds.multiplier == pytest.approx(t.bounds.multiplier, rel=1e-8)
    assert s.sharp_bounds.u == pytest.approx(t.sharp_bounds.u, rel=1e-8)


def test_a_table_of_a_broken_line_has_the_bounds_of_its_formula():
    table = ul.Problem(SQUARE, "4*x - 3", {0: ROWS, 1: 0, 2: 0, 3: 0})
    assert_same_solution(table, ul.Problem(SQUARE, "4*x - 3", [FORMULA, 0, 0, 0]))
    # negative control: one value by 0.01 larger
    s, values = ROWS
    raised = ul.Problem(SQUARE, "4*x - 3", [(s, values + np.array([0, 0.01, 0, 0])), 0, 0, 0])
    with pytest.raises(AssertionError):
        assert_same_solution(raised, table)


def test_u_and_q_may_be_tables():
    options = {"c": 0, "free_sides": [2]}
    line = (ROWS[0], ROWS[0] / 8)
    table = ul.Problem(SQUARE, -1, {1: "-1/2", 3: "-1/2"}, u={0: line}, q={2: ROWS}, **options)
    # on side 2, s is 1 - x
    flux = FORMULA.replace("x", "(1 - x)")
    formula = ul.Problem(SQUARE, -1, [None, "-1/2", None, "-1/2"], u={0: "x/8"}, q=flux, **options)
    assert_same_solution(table, formula)


def test_u_may_have_kinks_in_a_table():
    """A formula's slope is known less well at its kinks, so that the bound for the table is smaller."""
    table = ul.Problem(SQUARE, -1, -1, c=0, free_sides=[2], u={0: ROWS})
    formula = ul.Problem(SQUARE, -1, -1, c=0, free_sides=[2], u={0: FORMULA})
    s = ul.solve(table, **SIZES)
    t = ul.solve(formula, **SIZES)
    np.testing.assert_allclose(s.u, t.u, rtol=0, atol=1e-9)
    assert s.bounds.u < t.bounds.u


def test_ten_thousand_rows_take_as_many_pieces_and_no_more():
    """A table of sin has its bounds up to the slope's error of interpolation, |sin''| h / 2 <= 5e-5."""
    s = np.linspace(0, 1, 10_000)
    table = ul.Problem(SQUARE, "4*x - 3", {0: (s, np.sin(3 * s) * (1 - s) / 10), 1: 0, 2: 0, 3: 0})
    assert len(table.enclosed_obstacle.side) == 9_999 + 3
    assert table.enclosed_obstacle.remainder.max() < 1e-13
    solution = ul.solve(table, accuracy=0.05)
    expected = ul.solve(ul.Problem(SQUARE, "4*x - 3", ["sin(3*x)*(1 - x)/10", 0, 0, 0]), accuracy=0.05)
    assert solution.certified
    assert solution.u.shape == expected.u.shape
    assert solution.bounds.u == pytest.approx(expected.bounds.u, rel=1e-4)
    assert solution.forces().whole.lower == pytest.approx(expected.forces().whole.lower, rel=1e-4)


def model_faults(table, exact_length):
    """How often the models of a table's edges do not contain it, in rational arithmetic, and its slope."""
    faults = [0, 0]
    a = table.t[:-1]
    b = table.t[1:]
    on_edges = affine_model(monomial_basis(1, 3), 0.5 * (a + b), 0.5 * (b - a)[None], (a, b))
    value_model = table.value_model(on_edges)
    slope_model = table.slope_model(on_edges)
    s = [Fraction(str(x)) / exact_length for x in RAMP_PLACES]
    for i in range(len(a)):
        slope = (Fraction(table.values[i + 1]) - Fraction(table.values[i])) / (s[i + 1] - s[i])
        faults[1] += abs(slope - Fraction(slope_model.c[0, i])) > Fraction(slope_model.rad[i])
        for sigma in (Fraction(-1), Fraction(-1, 3), Fraction(1)):
            place = (Fraction(a[i]) + Fraction(b[i])) / 2 + sigma * (Fraction(b[i]) - Fraction(a[i])) / 2
            j = max(k for k in range(len(a)) if k == 0 or s[k] <= place)
            value = Fraction(table.values[j]) + (place - s[j]) * (
                Fraction(table.values[j + 1]) - Fraction(table.values[j])
            ) / (s[j + 1] - s[j])
            near = sum(Fraction(c) * sigma**k for k, c in enumerate(value_model.c[:, i].tolist()))
            faults[0] += abs(value - near) > Fraction(value_model.rad[i])
    return faults


RAMP_PLACES = [0, "0.1", "0.10000001", "0.7", "0.70000003", "1.4142135623730951"]
SQRT_2 = Fraction(isqrt(2 * 10**60), 10**30)


def test_the_model_of_a_table_counts_the_rounding_of_its_places():
    """On a side of the length 2^(1/2), with ramps of 1e-8 by 1: a place that is off by 1e-16 counts 1e-8."""
    values = np.array([0.0, 0.3, 1.3, 1.2, 0.1, 0.0])
    s = np.array([float(x) for x in RAMP_PLACES])
    table = make_table(TableRows(s, values, "table", None), 0, float(np.sqrt(2)))
    assert model_faults(table, SQRT_2) == [0, 0]
    # negative control: places that were exact
    unrounded = type(table)(table.t, table.values)
    assert min(model_faults(unrounded, SQRT_2)) > 0


def write_problem(folder, text, g="{0: {table: tables/surface.csv}, 1: 0, 2: 0, 3: 0}"):
    """A problem file beside a folder with a table."""
    (folder / "tables").mkdir()
    content = text if isinstance(text, bytes) else text.encode()
    (folder / "tables" / "surface.csv").write_bytes(content)
    file = folder / "own.yaml"
    file.write_text(f"polygon: [[0, 0], [1, 0], [1, 1], [0, 1]]\nf: 4*x - 3\ng: {g}\n")
    return file


@pytest.mark.parametrize(
    "text",
    [
        "s,g\n0,0\n0.25,0.1\n0.6,-5e-2\n1,0\n",
        "0;0\r\n.25;0.1\r\n0.6;-0.05\r\n1.;0",
        "# s g, by numpy.savetxt\n0 0\n\n0.25\t0.1\n 0.6   -0.05 \n1 0\n",
        b"\xef\xbb\xbfs (mm), height\n0, 0\n0.25, +0.1\n0.6, -0.05\n1.000001, 0\n",
    ],
)
def test_a_file_is_found_beside_its_problem_and_read(tmp_path, monkeypatch, text):
    monkeypatch.chdir("/")
    problem = ul.load(write_problem(tmp_path, text))
    np.testing.assert_array_equal(problem.g[0].values, ROWS[1])
    np.testing.assert_allclose(problem.g[0].t, ROWS[0], rtol=0, atol=1e-15)


@pytest.mark.parametrize(
    ("text", "place"),
    [
        ("0;0\n0,5;1\n1;0\n", "line 2"),
        ("0,5,1,2\n", "line 1"),
        ("s;g\n0;0,5\n", "line 2"),
        ("0,5 1,25\n", "line 1"),
        ("0,0\n0.5,0,1\n1,0\n", "line 2"),
        ("0,0\n0.5,nan\n1,0\n", "line 2"),
        ("0,0\n0.5,1e999\n1,0\n", "line 2"),
        ("0,0\n0.5 m,1\n1,0\n", "line 2"),
        ("0,0\n\n0.7,1\n0.5,1\n1,0\n", "line 4"),
        ("0,0\n0.5,0\n0.5,1\n1,1\n", "line 3"),
        ("0,0\n0.5,0\n0.5,0\n1,0\n", "line 3"),
        ("0.1,0\n1,0\n", "line 1"),
        ("0,0\n1000,0\n", "line 2"),
        ("0,0\n", "1 row"),
        ("s,g\n", "0 rows"),
        ("\n".join(f"{i}e-4,0" for i in range(10_001)), "10001 rows"),
        (b"\xff\xfe0\x00", "UTF-8"),
        (b"0" * 2_000_001, "bytes"),
    ],
)
def test_a_file_that_is_no_table_is_refused(tmp_path, text, place):
    with sentences.raises(InputError, "surface.csv", place):
        ul.load(write_problem(tmp_path, text))


@pytest.mark.parametrize(
    "g",
    [
        "{0: {table: other.csv}, 1: 0, 2: 0, 3: 0}",
        "{0: {table: tables}, 1: 0, 2: 0, 3: 0}",
        "{0: {file: tables/surface.csv}, 1: 0, 2: 0, 3: 0}",
        "{table: tables/surface.csv}",
        "{0: {table: tables/surface.csv}}",
        "{0: {table: tables/surface.csv}, 1: 0, 2: 0, 3: 1}",
        "{0: 0, 1: 0, 2: 0, 3: 0, 4: 0}",
        "{0: 0, +0: 0, 1: 0, 2: 0, 3: 0}",
        "{0:0, 1: 0}",
        "{0: [0, 1]}",
    ],
)
def test_a_mapping_that_does_not_fit_the_sides_is_refused(tmp_path, g):
    with sentences.raises(InputError, "own.yaml"):
        ul.load(write_problem(tmp_path, "0,0\n1,0\n", g))


@pytest.mark.parametrize(
    "g",
    [
        {0: (np.zeros(3), np.zeros(4))},
        {0: (np.zeros((2, 2)), np.zeros((2, 2)))},
        {0: ([0, 1], "ab")},
        {0: (np.linspace(0, 1, 10_001), np.zeros(10_001))},
        {0: ([0, 0.5, 0.5, 1], [0, 0, 1, 1])},
        {0: ([0, 0.5, np.nan, 1], [0, 0, 1, 1])},
        {0: ([0, 0.5, 1], [0, np.inf, 1])},
        {0: ([0, 0.5, 1], [0, -1e300, 1e300])},
        {0: {"table": 5}},
        {4: ROWS},
        {0: (ROWS, ROWS)},
    ],
)
def test_arrays_that_are_no_table_are_refused(g):
    with sentences.raises(InputError, "field g"):
        ul.Problem(SQUARE, 0, {1: 0, 2: 0, 3: 0} | g)


def test_f_is_no_table():
    with sentences.raises(InputError, "field f"):
        ul.Problem(SQUARE, ROWS, 0)


def test_no_certificate_states_a_table(tmp_path):
    solution = ul.solve(ul.Problem(SQUARE, "4*x - 3", [ROWS, 0, 0, 0]), h=1 / 4, H=1 / 2)
    with sentences.raises(InputError, "field g[0]"):
        solution.save_certificate(tmp_path / "certificate.json")


def test_check_tells_of_a_table_and_draws_it(run, tmp_path):
    picture = tmp_path / "own.svg"
    file = write_problem(tmp_path, "0,0\n0.25,0.1\n0.6,-0.05\n1,0\n")
    code, out, err = run("check", str(file), "-o", str(picture))
    assert (code, err) == (0, "")
    assert "side 0      (0, 0) to (1, 0), length 1: u >= a table of 4 rows, from -0.05 to 0.1\n" in out
    assert picture.stat().st_size > 0
