"""The tables behind the figures: from a made-up study whose numbers are known, and from one solution."""

from math import sqrt, tanh

import numpy as np
import pytest
import xarray as xr
from conftest import discrete, load

from unilateral.geometry import mesh, partition
from unilateral.geometry.polygon import named
from unilateral.study.figures.figure_data import SAMPLES_PER_SIDE, grid_frame, portrait_frames, rates_frame

LEVELS = np.array([0.5, 0.25, 0.125])
SQUARE = named("square")


def errors():
    """Error 10 h + H in all norms, in H^{-1/2} the r.m.s. mean of its bounds, along H = 2 h and H = h.

    beta = 0 at H = h, where only u has an error.
    """
    h, H = LEVELS[:, None], np.array([1.0, *LEVELS])[None]
    run = ("case", "mesh", "partition")
    value = np.where((2 * h == H) | (h == H), 10 * h + H, np.nan)[None]
    of_lambda = np.where(h == H, np.nan, value)
    algorithm = np.where(h == H, "active_set", np.where(2 * h == H, "uzawa", "")).astype(object)[None]
    return xr.Dataset(
        {
            "h1_error": (run, value),
            "hm12_error_lower": (run, 0.8 * of_lambda),
            "hm12_error_upper": (run, np.sqrt(2 - 0.8**2) * of_lambda),
            "l2_error": (run, of_lambda),
            "algorithm": (run, algorithm),
        },
        coords={
            "case": ["made_up"],
            "h": ("mesh", LEVELS),
            "H": ("partition", H[0]),
            "h_over_H": (("mesh", "partition"), h / H),
        },
        attrs={"scene": "scene"},
    )


def rates():
    index, pairs = ("case", "norm", "h_over_H"), ("case", "norm", "h_over_H", "pair")
    shape = (1, 3, 1)
    return xr.Dataset(
        {
            name: (index, np.full(shape, value))
            for name, value in (("fitted", 0.9), ("proved", 1.0), ("expected", 1.5))
        }
        | {
            "h_coarse": (pairs, np.broadcast_to(LEVELS[:2], (*shape, 2))),
            "h_fine": (pairs, np.broadcast_to(LEVELS[1:], (*shape, 2))),
            "asymptotic": (pairs, np.broadcast_to([0.0, 1.0], (*shape, 2))),
        },
        coords={"case": ["made_up"], "norm": ["h1", "hm12", "l2"], "h_over_H": [0.5]},
    )


def test_the_frame_of_rates():
    frame = rates_frame(errors(), rates())
    assert len(frame) == 3 * 3
    for _, rows in frame.groupby("norm"):
        assert rows["h"].tolist() == LEVELS.tolist()
        assert rows["H"].tolist() == (2 * LEVELS).tolist()
        np.testing.assert_allclose(rows["error"], 12 * LEVELS, rtol=1e-15)
        assert rows["asymptotic"].tolist() == [0, 1, 1]
    for column, value in (
        ("scene", "scene"),
        ("case", "made_up"),
        ("h_over_H", 0.5),
        ("rate", 0.9),
        ("proved", 1.0),
    ):
        assert set(frame[column]) == {value}


def test_the_frame_of_the_grid():
    frame = grid_frame(errors(), ["made_up"])
    assert len(frame) == 3 * 3 * 4
    np.testing.assert_allclose(frame["h_over_H"], frame["h"] / frame["H"], rtol=1e-15)
    beta_zero = (frame["h"] == frame["H"]).astype(int)
    assert frame["beta_zero"].tolist() == beta_zero.tolist()
    solved = (frame["H"] == 2 * frame["h"]) | ((frame["norm"] == "h1") & (frame["H"] == frame["h"]))
    assert frame["error"].notna().tolist() == solved.tolist()
    kept = frame[solved]
    np.testing.assert_allclose(kept["error"], 10 * kept["h"] + kept["H"], rtol=1e-15)


@pytest.fixture(scope="module")
def portrait():
    return portrait_frames(load("natural"), mesh.structured(SQUARE, 1 / 16), partition.uniform(SQUARE, 1 / 8))


def test_the_portrait_s_triangles(portrait):
    """Each with its three corners: they cover the square, and u_h is one value at each node."""
    field, _ = portrait
    corners = field[["x", "y"]].to_numpy().reshape(-1, 3, 2)
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    areas = 0.5 * (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
    assert np.all(areas > 0)
    assert areas.sum() == pytest.approx(1, rel=1e-12)
    assert field["triangle"].tolist() == np.repeat(np.arange(2 * 16**2), 3).tolist()
    nodes = field.groupby(["x", "y"])["u_h"]
    assert nodes.ngroups == 17**2
    assert (nodes.nunique() == 1).all()


def test_the_portrait_s_u_h_is_the_solution_s(portrait):
    field, _ = portrait
    nodes = mesh.structured(SQUARE, 1 / 16).triangles.ravel()
    expected = discrete("natural", 16, 8).solve().u_h[nodes]
    np.testing.assert_allclose(field["u_h"], expected, rtol=1e-9, atol=1e-12)


def test_the_portrait_s_traces(portrait):
    """The gap and lambda as declared; contact for x >= 1/2 on the bottom, and on all other sides."""
    _, boundary = portrait
    trace, flux = (boundary[boundary["kind"] == kind] for kind in ("trace", "flux"))
    assert len(trace) == len(flux) == 4 * (SAMPLES_PER_SIDE + 1)
    x = trace["s"].to_numpy()
    bottom = trace["side"] == 0
    free = bottom & (trace["s"] < 0.5)
    assert trace["contact"].tolist() == (~free).astype(int).tolist()
    gap = np.where(free, 2 * x * np.maximum(0.5 - x, 0) ** 1.5, 0)
    np.testing.assert_allclose(trace["exact"], gap, atol=1e-15)
    held = 1.5 * np.sqrt(np.maximum(x - 0.5, 0))
    np.testing.assert_allclose(flux["exact"][flux["side"] == 0], held[bottom], atol=1e-12)
    assert flux["computed"].isna().all()


def test_the_portrait_s_errors_are_those_of_the_solution(portrait):
    """int |u - u_h|^2 on the boundary <= ||u - u_h||_1^2 / sigma_1; on the square sigma_1 is known."""
    _, boundary = portrait
    solution = discrete("natural", 16, 8).solve()
    trace = boundary[boundary["kind"] == "trace"]
    mean_square = np.mean((trace["computed"] - trace["exact"]) ** 2)
    assert sqrt(4 * mean_square) <= solution.h1_error / sqrt(tanh(1 / (2 * sqrt(2))) / sqrt(2))
    cells = boundary[boundary["kind"] == "multiplier"]
    np.testing.assert_allclose(cells["computed"], solution.lambda_H, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(cells["end"] - cells["s"], 1 / 8, rtol=1e-12)
    assert cells["side"].tolist() == np.repeat(np.arange(4), 8).tolist()


def test_no_contact_has_none():
    cells = partition.uniform(SQUARE, 1 / 4)
    _, boundary = portrait_frames(load("no_contact"), mesh.structured(SQUARE, 1 / 8), cells)
    assert set(boundary["contact"].dropna()) == {0}
    assert np.all(boundary["computed"][boundary["kind"] == "multiplier"] == 0)
