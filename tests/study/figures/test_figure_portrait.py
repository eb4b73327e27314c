"""The picture of a solution: its tables against the solution, and what they have to hold."""

from math import sqrt, tanh

import numpy as np
import pytest
from conftest import discrete
from pages import committed, drawn

from unilateral.discrete import solve
from unilateral.geometry.polygon import named
from unilateral.geometry.structured import structured
from unilateral.study.figures import portrait


@pytest.fixture(scope="module")
def natural():
    table = portrait.table("square", "natural", "1/16", "1/8")
    of_mesh = table["kind"] == "mesh"
    return {"mesh": table[of_mesh], "boundary": table[~of_mesh]}


def test_the_portrait_s_triangles(natural):
    """Each with its three corners: they cover the square, and u_h is one value at each node."""
    field = natural["mesh"]
    corners = field[["x", "y"]].to_numpy().reshape(-1, 3, 2)
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    areas = 0.5 * (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
    assert np.all(areas > 0)
    assert areas.sum() == pytest.approx(1, rel=1e-12)
    assert len(areas) == 2 * 16**2
    nodes = field.groupby(["x", "y"])["computed"]
    assert nodes.ngroups == 17**2
    assert (nodes.nunique() == 1).all()


def test_the_portrait_s_u_h_is_the_solution_s(natural):
    field = natural["mesh"]
    nodes = structured(named("square"), 1 / 16).triangles.ravel()
    expected = solve(discrete("natural", 16, 8)).u_h[nodes]
    np.testing.assert_allclose(field["computed"], expected, rtol=1e-9, atol=1e-12)


def test_the_portrait_s_traces(natural):
    """The gap and lambda as declared; contact for x >= 1/2 on the bottom, and on all other sides."""
    boundary = natural["boundary"]
    trace, flux = (boundary[boundary["kind"] == kind] for kind in ("trace", "flux"))
    assert len(trace) == len(flux) == 4 * (portrait.SAMPLES_PER_SIDE + 1)
    x = trace["s"].to_numpy()
    bottom = trace["side"] == 0
    free = bottom & (trace["s"] < 0.5)
    assert trace["contact"].tolist() == (~free).astype(int).tolist()
    gap = np.where(free, 2 * x * np.maximum(0.5 - x, 0) ** 1.5, 0)
    np.testing.assert_allclose(trace["exact"], gap, atol=1e-15)
    held = 1.5 * np.sqrt(np.maximum(x - 0.5, 0))
    np.testing.assert_allclose(flux["exact"][flux["side"] == 0], held[bottom], atol=1e-12)
    assert flux["computed"].isna().all()


def test_the_portrait_s_errors_are_those_of_the_solution(natural):
    """int |u - u_h|^2 on the boundary <= ||u - u_h||_1^2 / sigma_1; on the square sigma_1 is known."""
    boundary = natural["boundary"]
    solution = solve(discrete("natural", 16, 8))
    trace = boundary[boundary["kind"] == "trace"]
    mean_square = np.mean((trace["computed"] - trace["exact"]) ** 2)
    assert sqrt(4 * mean_square) <= solution.errors.h1 / sqrt(tanh(1 / (2 * sqrt(2))) / sqrt(2))
    cells = boundary[boundary["kind"] == "multiplier"]
    np.testing.assert_allclose(cells["computed"], solution.lambda_H, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(cells["end"] - cells["s"], 1 / 8, rtol=1e-12)
    assert cells["side"].tolist() == np.repeat(np.arange(4), 8).tolist()


def test_no_contact_has_none():
    boundary = portrait.table("square", "no_contact", "1/8", "1/4")
    assert set(boundary["contact"].dropna()) == {0}
    assert np.all(boundary["computed"][boundary["kind"] == "multiplier"] == 0)


def test_the_bar_of_colours_is_as_high_as_the_picture():
    """Of a solution twice as wide as high, too."""
    rows = committed("portrait")
    figure, _ = drawn("portrait", rows.assign(x=2 * rows["x"]))
    figure.draw_without_rendering()
    picture, bar = (axes.get_window_extent() for axes in (figure.axes[0], figure.axes[0].child_axes[0]))
    assert (bar.y0, bar.y1) == pytest.approx((picture.y0, picture.y1))
    assert picture.height < 0.6 * picture.width
