"""The picture of a solution: what it shows, and that its bytes are always the same."""

import math

import numpy as np
import pytest
from conftest import DATA

import unilateral as ul
from unilateral.formulas.decimals import up
from unilateral.solution import plot

pytestmark = pytest.mark.usefixtures("shared_cases")
SQUARE = [(0, 0), (1, 0), (1, 1), (0, 1)]
SIZES = {"h": 1 / 16, "H": 1 / 8}


@pytest.fixture(scope="module")
def adapted():
    """At a re-entrant corner meshes are adapted."""
    s = ul.solve(ul.load(DATA / "problems/lshape.yaml"), accuracy=0.3)
    assert s.mesh.adapted
    return s


@pytest.mark.parametrize("ending", ["svg", "png", "pdf"])
def test_pictures_have_the_same_bytes_every_time(tmp_path, adapted, ending):
    """And begin as their format does."""
    for name in ("a", "b"):
        adapted.save(tmp_path / f"{name}.{ending}")
    one, other = ((tmp_path / f"{name}.{ending}").read_bytes() for name in ("a", "b"))
    assert one == other
    assert one.startswith({"svg": b"<?xml", "png": b"\x89PNG", "pdf": b"%PDF"}[ending])


def test_a_mesh_is_drawn_where_it_is_adapted(adapted):
    """Its triangles are counted in a title; a uniform mesh is not drawn."""
    titles = [axes.get_title() for axes in adapted.plot().axes]
    assert f"the mesh: {len(adapted.mesh.triangles)} triangles" in titles
    uniform = ul.solve(ul.case("natural"), **SIZES)
    assert not any("mesh" in axes.get_title() for axes in uniform.plot().axes)


def test_the_picture_shows_contact_and_gap():
    """The cells with lambda_H > 0 are drawn, and both steps along the boundary, whose sides have numbers."""
    s = ul.solve(ul.case("natural"), **SIZES)
    page = s.plot()
    top, flux, gap = page.axes
    assert len(top.collections[-1].get_segments()) == len(s.contact.intervals) == 4
    np.testing.assert_array_equal(flux.patches[0].get_data().values, s.multiplier)
    held = s.multiplier > 0
    np.testing.assert_array_equal(gap.patches[0].get_data().values, np.where(held, 0, s.gap))
    assert not gap.texts
    (names,) = flux.child_axes
    assert [label.get_text() for label in names.get_xticklabels()] == [f"side {i}" for i in range(4)]


@pytest.mark.parametrize(
    ("g", "free", "said"),
    [(0, [], "on the whole boundary"), ([0, 0, 0, None], [3], "on all sides that are not free")],
)
def test_the_picture_of_a_contact_everywhere_shows_no_remainder_of_the_iteration(g, free, said):
    """f < 0 = g presses u down; of this loose tolerance means of u_h - g are up to 1e-3, of both signs."""
    s = ul.solve(ul.Problem(SQUARE, f=-10, g=g, free_sides=free), **SIZES, stop=ul.Stop(tolerance=1e-2))
    assert np.nanmin(s.gap) < -1e-5
    gap = s.plot().axes[2]
    shown = gap.patches[0].get_data().values
    assert np.all(shown[np.isfinite(s.gap)] == 0)
    assert [text.get_text() for text in gap.texts] == [f"$u_h = g$ {said}"]
    assert gap.get_yticks().tolist() == [0]


def test_what_has_not_converged_is_drawn_as_it_is():
    """After one step nothing is known of what the iteration leaves; and u = g may be without contact."""
    with pytest.warns(Warning, match="algebraic"):
        s = ul.solve(ul.case("natural"), **SIZES, stop=ul.Stop(algorithm="uzawa", max_steps=1))
    gap = s.plot().axes[2]
    np.testing.assert_array_equal(gap.patches[0].get_data().values, s.gap)
    assert (np.abs(s.gap).max() > 1, len(gap.texts)) == (True, 0)
    zero = ul.solve(ul.Problem(SQUARE, f=0, g=0), **SIZES).plot()
    assert zero.axes[0].get_title().endswith("length 0")
    assert [text.get_text() for text in zero.axes[2].texts] == ["$u_h = g$ on the whole boundary"]


def test_the_gap_is_drawn_but_for_the_size_of_what_the_iteration_left():
    """By hand: 0.1 is seen of the 0 in contact, so 0.05 outside is nothing, and 0.2 is a gap."""
    gap, lambda_H = np.array([0.1, -0.05, 0.05, 0.2, math.nan]), np.array([1.0, 0, 0, 0, 0])
    np.testing.assert_array_equal(plot.settled(gap, lambda_H), [0, 0, 0, 0.2, math.nan])
    np.testing.assert_array_equal(plot.settled(gap[2:], 0 * gap[2:]), gap[2:])


def test_the_picture_says_what_is_certified(adapted):
    """The bound of the search, rounded up, and of a solution on given sizes the name alone."""
    bound = f"{up(adapted.search.best.total, '.2g')}, guaranteed"
    assert adapted.plot().get_suptitle().endswith(bound)
    assert ul.solve(ul.case("natural"), **SIZES).plot().get_suptitle() == "natural"


@pytest.mark.parametrize("height", [0.05, 1.0, 3.0])
def test_the_colour_bar_is_as_high_as_its_panel(height):
    """On flat and on tall domains, where the panel is smaller than its place on the page."""
    page = ul.solve(ul.Problem([(0, 0), (1, 0), (1, height), (0, height)], f="x", g=0), **SIZES).plot()
    page.draw_without_rendering()
    panel = page.axes[0]
    (bar,) = panel.child_axes
    heights = [axes.get_window_extent().height for axes in (panel, bar)]
    assert heights[0] == pytest.approx(heights[1], rel=1e-6)
