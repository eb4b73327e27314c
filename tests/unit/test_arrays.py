"""What users hand over as arrays: the numbers that are meant, or one sentence that says what is wrong.

NumPy reads masked numbers as those under the mask, a series in the order of its rows whatever its labels are,
complex numbers by their real parts, and cuts what is written into integers. The right answers are the plain
arrays that the inputs were made from.
"""

import re
from decimal import Decimal
from fractions import Fraction

import numpy as np
import pandas as pd
import pytest
import sentences
import xarray as xr

import unilateral as ul
from unilateral.arrays import read_floats, read_indices, read_nodal_values

SQUARE = ul.mesh([(0, 0), (1, 0), (1, 1), (0, 1)], [(0, 1, 2), (0, 2, 3)], halvings=1)
VALUES = np.linspace(-1, 1, SQUARE.n_nodes)
N = len(VALUES)
BACKWARDS = np.arange(N)[::-1]


def mask_number(array, place=4):
    """The array with one masked number, under which there is a fill value."""
    numbers = np.array(array, dtype=float)
    mask = np.arange(numbers.size).reshape(numbers.shape) == place
    numbers[mask] = 8e34
    return np.ma.array(numbers, mask=mask)


class Variable:
    """As a variable of netCDF4 that is not yet read: its array is a masked one."""

    def __array__(self, dtype=None, copy=None):
        return mask_number(VALUES)

    shape = VALUES.shape
    ndim = 1


def matrix(rows):
    """One of NumPy's old class, without the warning that it gives."""
    return np.asarray(rows).view(np.matrix)


class Lengths(np.ndarray):
    """As arrays with units, whose numbers are millimetres."""


TAKEN = {
    "an array": VALUES,
    "another byte order": VALUES.astype(">f8"),
    "every other one": np.repeat(VALUES, 2)[::2],
    "no mask": np.ma.array(VALUES),
    "a mask of none": np.ma.array(VALUES, mask=np.zeros(N, bool)),
    "a series": pd.Series(VALUES),
    "a column of a table": pd.DataFrame({"u": VALUES})["u"],
    "a nullable series": pd.Series(VALUES, dtype="Float64"),
    "xarray": xr.DataArray(VALUES, dims="node"),
    "xarray with labels": xr.DataArray(VALUES, {"node": np.arange(N)}, "node"),
    "a list": VALUES.tolist(),
}


@pytest.mark.parametrize("data", TAKEN.values(), ids=TAKEN)
def test_the_numbers_that_are_meant_are_taken(data):
    np.testing.assert_array_equal(read_floats(data, "f"), VALUES)
    np.testing.assert_array_equal(read_nodal_values(data, "f"), VALUES)


MASKED = "1 of 9 numbers are masked, the first at the place 4; give an array without masked numbers"
REFUSED = {
    "masked": (mask_number(VALUES), MASKED),
    "a variable of netCDF4": (Variable(), MASKED),
    "a list of masked arrays": ([mask_number(VALUES[:5]), VALUES[:5]], "1 of 5 numbers are masked"),
    "the masked number": ([np.ma.masked, 1.0], "1 of 1 numbers are masked"),
    "a series in another order": (
        pd.Series(VALUES)[::-1],
        "the labels of the Series begin with 8, 7, 6, 5; they have to be 0, 1, 2, … in order, or give its "
        ".to_numpy() if its rows are in the right order",
    ),
    "a part of a series": (pd.Series(VALUES)[1:], "the labels of the Series begin with 1, 2, 3, 4"),
    "named rows": (pd.Series([1.0, 2.0], ["a", "b"]), "the labels of the Series begin with a, b"),
    "rows by time": (
        pd.Series([1.0, 2.0], pd.date_range("2000-01-01", periods=2)),
        "the labels of the Series begin with 2000-01-01",
    ),
    "xarray in another order": (
        xr.DataArray(VALUES, {"node": BACKWARDS}, "node"),
        "the labels of the DataArray begin with 8, 7, 6, 5",
    ),
    "complex": (VALUES + 0j, "it holds values of the type complex128; it has to be an array of real numbers"),
    "Booleans": (VALUES > 0, "it holds values of the type bool"),
    "texts": (VALUES.astype(str), "it has to be an array of real numbers"),
    "objects": (VALUES.astype(object), "it holds values of the type object"),
    "times": (np.array([1, 2], "datetime64[s]"), "it holds values of the type datetime64[s]"),
    "records": (np.zeros(3, [("x", float), ("y", float)]), "it has to be an array of real numbers"),
    "a matrix": (matrix([[1.0, 2.0]]), "a matrix may stand for other numbers than it holds"),
    "units": (
        VALUES.view(Lengths),
        "a Lengths may stand for other numbers than it holds; give a plain array",
    ),
    "a list of texts": (["1", "2"], "['1', '2']; it has to be an array of real numbers"),
    "a ragged list": ([[1, 2], [3]], "[[1, 2], [3]]; it has to be an array of real numbers"),
    "nothing": (None, "None; it has to be an array of real numbers"),
    "a complex one among fractions": ([Fraction(1, 3), 1j], "has to be an array of real numbers"),
    "a set": ({1.0, 2.0}, "{1.0, 2.0}; it has to be an array of real numbers"),
}


@pytest.mark.parametrize(("data", "message"), REFUSED.values(), ids=REFUSED)
def test_what_numpy_would_read_as_other_numbers_is_refused(data, message):
    expected = "it has to be an array of real numbers"
    for door in (read_floats, read_nodal_values, read_indices):
        with pytest.raises(ul.InputError, match=re.escape(message)) as refused:
            door(data, "f", expected)
        assert str(refused.value).startswith("f: ")
        assert "\n" not in str(refused.value)


def test_labels_and_masks_are_refused_wherever_they_are():
    """Orders and masks that are drawn are taken only if every number is the right one of its place."""
    draw = np.random.default_rng(45)
    outcomes = set()
    for _ in range(300):
        n = int(draw.integers(1, 6))
        labels = draw.permutation(n) + int(draw.random() < 0.2)
        mask = draw.random(n) < 0.15
        for labelled in (
            pd.Series(draw.random(n), labels),
            xr.DataArray(draw.random(n), {"node": labels}, "node"),
        ):
            right = labels.tolist() == list(range(n))
            outcomes.add((right, expect_refusal(labelled)))
        outcomes.add((not mask.any(), expect_refusal(np.ma.array(draw.random(n), mask=mask))))
        outcomes.add(
            (not mask.any(), expect_refusal([np.ma.array(draw.random(n), mask=mask), draw.random(n)]))
        )
    assert outcomes == {(True, False), (False, True)}


def expect_refusal(data):
    try:
        read_floats(data, "f")
    except ul.InputError:
        return True
    return False


def test_columns_are_x_and_y_in_this_order():
    table = pd.DataFrame({"x": [0.0, 1, 0], "y": [0.0, 0, 1]})
    np.testing.assert_array_equal(read_floats(table, "points"), [(0, 0), (1, 0), (0, 1)])
    with sentences.raises(ul.InputError):
        read_floats(table[["y", "x"]], "points")


def test_missing_numbers_of_a_series_are_no_numbers():
    series = pd.Series([*range(N - 1), None], dtype="Int64")
    assert np.isnan(read_floats(series, "f")[-1])
    with sentences.raises(ul.InputError):
        ul.Problem(SQUARE, series, 0)


def test_values_at_nodes_are_no_integers():
    """A constant, too: np.full(n, 0) with 0.5 written into it is 0 everywhere."""
    for values in (np.full(N, -1), np.zeros(N, np.uint8), pd.Series(np.arange(N)), [1, 2]):
        np.testing.assert_array_equal(read_floats(values, "points"), np.asarray(values))
        with sentences.raises(ul.InputError):
            read_nodal_values(values, "f")
    assert read_nodal_values(3, "f") == 3


def test_numbers_of_python_are_taken():
    assert read_floats([Fraction(1, 3), Decimal("0.5"), 2**70], "t").tolist() == [1 / 3, 0.5, 2.0**70]


def test_the_numbers_of_nodes_are_whole():
    np.testing.assert_array_equal(read_indices([[0.0, 2.0]], "triangles"), [[0, 2]])
    for indices in ([0.5], [np.nan], [np.inf], [1e300]):
        with sentences.raises(ul.InputError):
            read_indices(indices, "triangles")


def test_what_is_given_is_not_changed_afterwards():
    mine = VALUES.copy()
    problem = ul.Problem(SQUARE, mine, 0)
    mine[:] = 7
    np.testing.assert_array_equal(problem.f, VALUES)


BAD = {
    "a mask": mask_number(VALUES),
    "another order": pd.Series(VALUES)[::-1],
    "complex": VALUES + 1j,
    "integers": np.full(N, -1),
    "a matrix": matrix(VALUES),
}
PLACES = {
    "f": lambda bad: ul.Problem(SQUARE, bad, 0),
    "g": lambda bad: ul.Problem(SQUARE, -1, bad),
    "g of a side": lambda bad: ul.Problem(SQUARE, -1, [bad, 0, 0, 0]),
    "q": lambda bad: ul.Problem(SQUARE, -1, [0, 0, 0, None], free_sides=[3], q=bad),
    "u": lambda bad: ul.Problem(SQUARE, -1, [0, 0, 0, None], u={3: bad}),
    "f of a call": lambda bad: ul.Solver(SQUARE, H=0.5)(f=bad, g=0),
    "g of a call": lambda bad: ul.Solver(SQUARE, H=0.5)(f=-1, g=bad),
    "f as a function": lambda bad: ul.solve(ul.Problem(SQUARE, lambda x, y: bad, 0), H=0.5),
}


@pytest.mark.parametrize("bad", BAD.values(), ids=BAD)
@pytest.mark.parametrize("place", PLACES.values(), ids=PLACES)
def test_every_place_for_values_has_the_same_door(place, bad):
    with sentences.raises(ul.InputError):
        place(bad)


POINTS = SQUARE.points
GEOMETRY = {
    "points": lambda bad: ul.mesh(bad(POINTS), SQUARE.triangles),
    "triangles": lambda bad: ul.mesh(POINTS, bad(SQUARE.triangles)),
    "polygon": lambda bad: ul.Problem(bad([(0, 0), (1, 0), (1, 1), (0, 1)]), -1, 0),
    "solver": lambda bad: ul.Solver(bad([(0, 0), (1, 0), (1, 1), (0, 1)]), H=0.5, h=0.5),
    "u_at": lambda bad: SOLUTION.u_at(bad(POINTS)),
    "grad_at": lambda bad: SOLUTION.grad_at(bad(POINTS)),
    "flux_at": lambda bad: SOLUTION.flux_at(bad(POINTS)),
    "lambda_at": lambda bad: SOLUTION.lambda_at(0, bad([0.1, 0.2])),
}
SPOILT = {
    "a mask": lambda rows: mask_number(rows, 1),
    "another order": lambda rows: pd.DataFrame(np.asarray(rows))[::-1],
    "complex": lambda rows: np.asarray(rows) + 0j,
    "texts": lambda rows: np.asarray(rows).astype(str),
    "Booleans": lambda rows: np.asarray(rows) > 0.5,
    "a matrix": matrix,
}
SOLUTION = ul.solve(ul.Problem(SQUARE, -1, "-y/4"), H=1)


@pytest.mark.parametrize("bad", SPOILT.values(), ids=SPOILT)
@pytest.mark.parametrize("place", GEOMETRY.values(), ids=GEOMETRY)
def test_every_place_for_geometry_has_the_same_door(place, bad):
    place(np.asarray)
    with pytest.raises(ul.InputError):
        place(bad)


@pytest.mark.parametrize("name", ["k", "c", "f", "g"])
def test_a_number_may_be_masked_too(name):
    fields = {"f": -1, "g": 0} | {name: np.ma.masked}
    with sentences.raises(ul.InputError, name):
        ul.Problem([(0, 0), (1, 0), (0, 1)], **fields)


def test_the_force_of_a_function_of_one_point_at_a_time_is_not_of_its_integers():
    """f = 0 for x < 1/2 and -3/2 beyond; cut to -1 the force would be a third less.

    All of the boundary is in contact, so that u is linear in f; by symmetry in x the force is that of
    f = -3/4, the mean. Quadrature of the jump moves it by at most 3/2 times a column of triangles, h wide,
    times max w, where w <= 1 solves -lap w + w = 0 with w = 1 on the boundary.
    """

    def step(x, y):
        return 0 if x < 0.5 else -1.5

    square = [(0, 0), (1, 0), (1, 1), (0, 1)]
    h = 1 / 32
    force = (
        ul.solve(ul.Problem(square, np.vectorize(step, otypes=[float]), 0), h=h, H=2 * h).forces().whole.value
    )
    right = ul.solve(ul.Problem(square, -0.75, 0), h=h, H=2 * h).forces().whole.value
    assert force == pytest.approx(right, abs=1.5 * h)
    assert abs(right * 2 / 3 - force) > 3 * 1.5 * h
    with sentences.raises(ul.InputError):
        ul.solve(ul.Problem(square, np.vectorize(step), 0), h=h, H=2 * h)
