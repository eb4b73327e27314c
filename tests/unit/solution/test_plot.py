"""The picture of a solution: what it shows, and that its bytes are always the same."""

import math
import re

import numpy as np
import pytest
import sentences
from conftest import DATA
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

import unilateral as ul
from unilateral.solution import plot_domain
from unilateral.solution.plot import wrap_evenly
from unilateral.solution.plot_data import round_gap_to_zero

pytestmark = pytest.mark.usefixtures("shared_cases")
SQUARE = [(0, 0), (1, 0), (1, 1), (0, 1)]
SIZES = {"h": 1 / 16, "H": 1 / 8}


@pytest.fixture(scope="module")
def adapted_solution():
    """At a re-entrant corner meshes are adapted."""
    s = ul.solve(ul.load(DATA / "problems/lshape.yaml"), accuracy=0.3)
    assert s.mesh.is_adapted
    return s


@pytest.mark.parametrize("ending", ["svg", "png", "pdf"])
def test_pictures_have_the_same_bytes_every_time(tmp_path, adapted_solution, ending):
    """And begin as their format does."""
    for name in ("a", "b"):
        adapted_solution.save(tmp_path / f"{name}.{ending}")
    first = (tmp_path / f"a.{ending}").read_bytes()
    other_bytes = (tmp_path / f"b.{ending}").read_bytes()
    assert first == other_bytes
    assert first.startswith({"svg": b"<?xml", "png": b"\x89PNG", "pdf": b"%PDF"}[ending])


def test_a_mesh_is_drawn_where_it_is_adapted(adapted_solution):
    """Its triangles are counted in a title; a uniform mesh is not drawn."""
    titles = [axes.get_title() for axes in adapted_solution.plot().axes]
    assert f"the mesh: {len(adapted_solution.mesh.triangles)} triangles" in titles
    assert len(adapted_solution.mesh.triangles) < 1000
    uniform = ul.solve(ul.case("natural"), **SIZES)
    assert not any("mesh" in axes.get_title() for axes in uniform.plot().axes)


def test_the_picture_shows_contact_and_gap():
    """The cells with lambda_H > 0 are drawn, and both steps along the boundary, whose sides have numbers."""
    s = ul.solve(ul.case("natural"), **SIZES)
    page = s.plot()
    top, flux, gap = page.axes
    assert len(top.collections[-1].get_segments()) == len(s.contact.intervals) == 4
    np.testing.assert_array_equal(flux.patches[0].get_data().values, s.multiplier)
    in_contact = s.multiplier > 0
    np.testing.assert_array_equal(gap.patches[0].get_data().values, np.where(in_contact, 0, s.gap))
    assert not flux.texts
    assert not gap.texts
    (names,) = flux.child_axes
    assert [label.get_text() for label in names.get_xticklabels()] == ["side 0", "1", "2", "3"]
    assert {text.get_text() for text in top.texts} == {"0", "1", "2", "3"}
    (bar,) = top.child_axes
    assert bar.get_ylabel() == "$u_h$"


@pytest.mark.parametrize(
    ("g", "free", "message"),
    [(0, [], "everywhere"), ([0, 0, 0, None], [3], "on all sides that are not free")],
)
def test_the_picture_of_a_contact_everywhere_shows_no_remainder_of_the_iteration(g, free, message):
    """f < 0 = g presses u down; of this loose tolerance means of u_h - g are up to 1e-3, of both signs."""
    s = ul.solve(ul.Problem(SQUARE, f=-10, g=g, free_sides=free), **SIZES, stop=ul.Stop(tolerance=1e-2))
    assert np.nanmin(s.gap) < -1e-5
    gap = s.plot().axes[2]
    drawn_values = gap.patches[0].get_data().values
    assert np.all(drawn_values[np.isfinite(s.gap)] == 0)
    assert gap.texts[0].get_text() == f"in contact {message}"
    assert gap.get_yticks().tolist() == [0]


def test_what_has_not_converged_is_drawn_as_it_is():
    """After one step nothing is known of what the iteration leaves; and u = g may be without contact."""
    with pytest.warns(Warning, match="algebraic"):
        s = ul.solve(ul.case("natural"), **SIZES, stop=ul.Stop(algorithm="uzawa", max_steps=1))
    gap = s.plot().axes[2]
    np.testing.assert_array_equal(gap.patches[0].get_data().values, s.gap)
    assert (np.abs(s.gap).max() > 1, len(gap.texts)) == (True, 0)
    zero = ul.solve(ul.Problem(SQUARE, f=0, g=0), **SIZES).plot()
    assert zero.axes[0].get_title() == "no contact"
    assert [axes.texts[0].get_text() for axes in zero.axes[1:]] == ["no contact", "u = g everywhere"]


def test_the_gap_is_drawn_but_for_the_size_of_what_the_iteration_left():
    """By hand: 0.1 is seen of the 0 in contact, so 0.05 outside is nothing, and 0.2 is a gap."""
    gap = np.array([0.1, -0.05, 0.05, 0.2, math.nan])
    lambda_H = np.array([1.0, 0, 0, 0, 0])
    np.testing.assert_array_equal(round_gap_to_zero(gap, lambda_H), [0, 0, 0, 0.2, math.nan])
    np.testing.assert_array_equal(round_gap_to_zero(gap[2:], 0 * gap[2:]), gap[2:])


def test_the_title_is_that_of_the_problem_and_tells_the_relative_bound(adapted_solution):
    """The bound of the certificate, rounded up: not below it, and by less than a tenth above it."""
    title, accuracy = adapted_solution.plot().get_suptitle().split("\n")
    assert title == "a re-entrant corner, contact on both of its sides"
    report = re.fullmatch(r"error of u in H¹: at most ([\d.]+) %, guaranteed", accuracy)
    bound = 100 * adapted_solution.certificate()["h1_relative_bound"]
    assert bound <= float(report[1]) < 1.1 * bound <= 33


@pytest.mark.parametrize(
    ("data", "sizes", "message"),
    [
        ({}, SIZES, r"error of u in H¹: at most [\d.]+ %, guaranteed"),
        ({"k": 2}, SIZES, r"error of u in the energy norm: at most [\d.]+ %, guaranteed"),
        ({}, {"accuracy": 0.5, "norm": "hm12"}, r"error of λ in H\^\(−1/2\): at most [\d.]+ %, guaranteed"),
        ({}, {"accuracy": 1e-3, "max_unknowns": 99}, r"error of u .* %, guaranteed; 0.1 % was asked for"),
        ({}, {"accuracy": 1e-9, "max_unknowns": 99, "absolute": True}, r"error .*; 1e-09 was asked for"),
        ({"f": lambda x, y: x - 2}, SIZES, r"error .*, guaranteed; f linear between the nodes of the mesh"),
        ({"f": 0}, SIZES, r"error of u in H¹: at most [\d.e-]+, guaranteed"),
    ],
)
@pytest.mark.filterwarnings("ignore::unilateral.errors.SolutionWarning")
def test_the_picture_says_what_is_guaranteed(data, sizes, message):
    """In words, whatever was asked for; where u may be 0 the bound is no part of it."""
    s = ul.solve(ul.Problem(SQUARE, **({"f": "x - 2", "g": 0} | data)), **sizes)
    title, *lines = s.plot().get_suptitle().split("\n")
    assert title == "problem"
    assert re.fullmatch(message, " ".join(lines))


def test_long_titles_are_wrapped_evenly_and_too_long_ones_end():
    """By hand: 11 words of 4 letters need 2 lines of at most 30, and as even ones 29 and 24."""
    words = ["word"] * 11
    assert wrap_evenly(" ".join(words), 30) == [" ".join(words[:6]), " ".join(words[:5])]
    cut = wrap_evenly(" ".join(words * 9), 30)
    assert (len(cut), cut[-1][-4:]) == (3, " ...")
    assert wrap_evenly("", 30) == []


def test_a_title_is_no_formula():
    s = ul.solve(ul.Problem(SQUARE, f=-1, g=0, name="costs $5 or $x_{$"), **SIZES)
    s.plot().draw_without_rendering()


def test_the_lengths_of_edges_take_the_place_of_a_mesh_that_would_be_grey(adapted_solution, monkeypatch):
    """In colours on a logarithmic scale with a name: at a node their geometric mean."""
    monkeypatch.setattr(plot_domain, "MAX_OUTLINED_TRIANGLES", len(adapted_solution.mesh.triangles) - 1)
    page = adapted_solution.plot()
    array = page.axes[1].collections[0].get_array()
    (bar,) = page.axes[1].child_axes
    mesh = adapted_solution.mesh
    for node in range(0, mesh.n_nodes, 50):
        point = mesh.points[mesh.triangles[(mesh.triangles == node).any(axis=1)]]
        longest = np.linalg.norm(point - np.roll(point, 1, axis=1), axis=2).max(axis=1)
        assert array[node] == pytest.approx(np.prod(longest) ** (1 / len(longest)))
    assert (bar.get_yscale(), bar.get_ylabel()) == ("log", "longest edge")


def test_free_sides_are_marked_and_their_flux_is_drawn():
    """By hand: q = 4 y has the means 0.25, 0.75, ... on side 1, which H cuts in eight; q = -3 on side 3."""
    side_data = {"g": [0, None, 0, None], "free_sides": [1, 3], "q": [None, "4*y", None, -3]}
    s = ul.solve(ul.Problem(SQUARE, f="-1", **side_data), h=1 / 16, H=1 / 8)
    top, above, below = s.plot().axes
    patches = next(patch for patch in above.patches if patch.get_label() == "given flux q")
    means = np.full(32, np.nan)
    means[8:16] = np.arange(0.25, 4, 0.5)
    means[24:] = -3
    np.testing.assert_allclose(patches.get_data().values, means, rtol=1e-12)
    assert [text.get_text() for text in above.get_legend().get_texts()] == ["given flux q"]
    assert [text.get_text() for text in below.texts] == ["free", "free"]
    dashed = [lines for lines in top.collections if lines.get_linestyle()[0][1] is not None]
    assert [len(lines.get_segments()) for lines in dashed] == [2]
    units = ul.solve(ul.Problem(SQUARE, f="-1", k=3, c=5, **side_data), h=1 / 16, H=1 / 8)
    drawn = next(patch for patch in units.plot().axes[1].patches if patch.get_label() == "given flux q")
    np.testing.assert_allclose(drawn.get_data().values, means, rtol=1e-12)


def test_a_flux_that_is_a_function_is_drawn():
    """By hand: q = y in the middle of the cells of side 1."""
    side_data = {"g": [0, None, 0, 0], "free_sides": [1], "q": [None, lambda x, y: y, None, None]}
    s = ul.solve(ul.Problem(SQUARE, f=-1, **side_data), **SIZES)
    patches = next(patch for patch in s.plot().axes[1].patches if patch.get_label() == "given flux q")
    np.testing.assert_allclose(patches.get_data().values[8:16], np.arange(1 / 16, 1, 1 / 8), rtol=1e-12)


@pytest.mark.parametrize("width", [1 / 20, 20])
def test_a_domain_that_would_be_a_line_is_not_drawn_to_scale(width):
    """And says so; a square is."""
    flat = ul.solve(ul.Problem([(0, 0), (width, 0), (width, 1), (0, 1)], f=-1, g=0), h=1 / 8, H=1 / 4)
    domain = flat.plot().axes[0]
    assert (domain.get_aspect(), domain.get_title()[-14:]) == ("auto", "; not to scale")
    square = ul.solve(ul.case("natural"), **SIZES).plot().axes[0]
    assert (square.get_aspect(), "scale" in square.get_title()) == (1, False)


@pytest.mark.parametrize(
    ("f", "size"),
    [(1, 1), (0, 1), ("1e120*(x - 1/2)", 1e-6), ("1e-120*(x - 1/2)", 1e-6), ("1e120*(x - 1/2)", 1e6)],
)
def test_all_that_is_written_is_inside_the_page(f, size):
    """For constant, huge and tiny values and domains, as for others, and no warning is given."""
    square = (size * np.array(SQUARE)).tolist()
    page = ul.solve(ul.Problem(square, f=f, g=0, c=1 / size**2), h=size / 8, H=size / 4).plot()
    page.draw_without_rendering()
    drawn = page.get_tightbbox()
    (width, height) = page.get_size_inches()
    assert 0 <= drawn.x0 < drawn.x1 <= width
    assert 0 <= drawn.y0 < drawn.y1 <= height


def test_on_axes_of_a_figure_of_ones_own_the_domain_is_drawn(adapted_solution):
    """The axes come back, and the others of the figure stay empty."""
    remaining, right = Figure().subplots(1, 2)
    assert adapted_solution.plot(ax=right) is right
    assert not remaining.has_data()
    assert "contact" in right.get_title()
    np.testing.assert_array_equal(right.collections[0].get_array(), adapted_solution.u)


@pytest.mark.parametrize("layout", [None, "constrained", "tight"])
def test_on_axes_of_a_figure_of_ones_own_nothing_reaches_the_next_axes(adapted_solution, layout):
    """Whatever the layout of the figure is."""
    page = Figure(figsize=(9, 4), layout=layout)
    remaining, right = page.subplots(1, 2)
    adapted_solution.plot(ax=remaining)
    page.draw_without_rendering()
    assert remaining.get_tightbbox().x1 < right.get_window_extent().x0
    (bar,) = [axes for axes in page.axes if axes not in (remaining, right)]
    assert bar.get_tightbbox().x1 < right.get_window_extent().x0


def test_pictures_beside_each_other_do_not_overlap():
    """In a figure as matplotlib makes it, with a clamped side, whose legend is the widest part.

    Control: in one that is half as wide they do.
    """
    s = ul.solve(ul.Problem(SQUARE, -1, [0, None, None, None], free_sides=[1, 2], u={3: 5}), h=1 / 8, H=1 / 4)
    for width, overlaps in ((6.4, False), (3.2, True)):
        page = Figure(figsize=(width, 4.8))
        left_axes, right_axes = page.subplots(1, 2)
        s.plot(ax=left_axes)
        s.plot(ax=right_axes)
        page.draw_without_rendering()
        assert left_axes.get_tightbbox().overlaps(right_axes.get_tightbbox()) == overlaps


def test_the_colour_bar_of_a_picture_is_beside_its_axes(adapted_solution):
    """Control of what keeps off the next axes."""
    page = adapted_solution.plot()
    page.draw_without_rendering()
    (bar,) = page.axes[0].child_axes
    assert bar.get_window_extent().x0 > page.axes[0].get_window_extent().x1


@pytest.mark.parametrize("make", [lambda: 3, Figure, lambda: Figure().subplots(2)])
def test_what_are_no_axes_is_refused(adapted_solution, make):
    with sentences.raises(ul.InputError):
        adapted_solution.plot(ax=make())


@pytest.mark.parametrize("projection", ["polar", "3d"])
def test_axes_that_are_not_plane_are_refused(adapted_solution, projection):
    with sentences.raises(ul.InputError):
        adapted_solution.plot(ax=Figure().add_subplot(projection=projection))


@pytest.mark.parametrize("height", [0.05, 1.0, 3.0])
def test_the_colour_bar_is_as_high_as_its_panel(height):
    """On flat and on tall domains, where the panel is smaller than its place on the page."""
    page = ul.solve(ul.Problem([(0, 0), (1, 0), (1, height), (0, height)], f="x", g=0), **SIZES).plot()
    page.draw_without_rendering()
    panel = page.axes[0]
    (bar,) = panel.child_axes
    heights = [axes.get_window_extent().height for axes in (panel, bar)]
    assert heights[0] == pytest.approx(heights[1], rel=1e-6)


@pytest.fixture(scope="module")
def half_clamped_solution():
    """A square clamped at sides 0 and 3, in contact on side 1; side 2 is free."""
    return ul.solve(ul.Problem(SQUARE, -1, [None, -1, None, None], [2], u={0: 0, 3: 0}, c=0), **SIZES)


def ink(s, outside):
    """(n,) how many black dots a picture of the domain has beside each side, up to so far `outside` of it."""
    page = Figure(figsize=(4, 4), dpi=100)
    axes = s.plot(page.subplots())
    axes.set_axis_off()
    canvas = FigureCanvasAgg(page)
    canvas.draw()
    black = np.asarray(canvas.buffer_rgba())[::-1, :, :3].max(axis=2) < 64
    dark_pixels = []
    polygon = s.polygon
    for side in range(polygon.n_sides):
        s_ = np.linspace(0.05, 0.95, 400) * polygon.lengths[side]
        points = polygon.at(np.full(len(s_), side), s_)
        away = [points + share * outside * polygon.normals[side] for share in (0.5, 0.75, 1.0)]
        x, y = axes.transData.transform(np.concatenate(away)).astype(int).T
        dark_pixels.append(int(black[y, x].sum()))
    return np.array(dark_pixels)


def test_clamped_sides_are_hatched_outside(half_clamped_solution):
    """In black, as for walls, so that they are seen without colours; control: inside, and other sides."""
    outside = ink(half_clamped_solution, 0.015)
    inside = ink(half_clamped_solution, -0.015)
    assert np.all((outside > 100) == [True, False, False, True])
    assert np.all(outside[[1, 2]] == 0)
    assert np.all(inside == 0)


def test_a_legend_says_what_hatches_mean(half_clamped_solution):
    """Beside the domain, and along the boundary by hatches; control: nothing is clamped."""
    top, *along = half_clamped_solution.plot().axes
    assert [text.get_text() for text in top.get_legend().get_texts()] == ["clamped"]
    for axes in along:
        spans = [patch for patch in axes.patches if hasattr(patch, "get_x")]
        bands = {patch.get_x(): patch.get_hatch() for patch in spans if patch.get_height() == 1}
        assert bands == {0: "///", 2: None, 3: "///"}
    top, *_ = ul.solve(ul.case("natural"), **SIZES).plot().axes
    assert top.get_legend() is None


@pytest.mark.parametrize("u", [{}, {1: 0}])
def test_without_an_obstacle_no_contact_is_claimed(u):
    """Neither a gap nor contact; control: with an obstacle on one side there is contact on it."""
    sides = [side for side in range(4) if side not in u]
    page = ul.solve(ul.Problem(SQUARE, -1, None, sides, u=u), **SIZES).plot()
    texts = [text.get_text() for axes in page.axes for text in axes.texts]
    assert {"no contact", "no side has an obstacle"} <= {*texts}
    assert not any("in contact" in item for item in texts)
    page = ul.solve(ul.Problem(SQUARE, -1, [0, None, None, None], sides[1:], u=u), **SIZES).plot()
    assert any("in contact on all sides" in text.get_text() for axes in page.axes for text in axes.texts)


def test_a_bar_says_what_is_certain():
    """Black, white and hatched pieces at the foot of the last panel cover the sides with contact."""
    s = ul.solve("clamped", h=1 / 32, H=1 / 16)
    *_, axes = s.plot().axes
    bar = [patch for patch in axes.patches if hasattr(patch, "get_x") and patch.get_height() == 0.1]
    starts = s.polygon.starts
    places = [(starts[arc.side] + arc.start, arc.end - arc.start) for arc in s.contact.certain]
    assert [(piece.get_x(), piece.get_width()) for piece in bar] == [pytest.approx(place) for place in places]
    hatched = {
        piece.get_hatch()
        for piece, arc in zip(bar, s.contact.certain, strict=True)
        if arc.verdict == "not decided"
    }
    assert hatched == {"xxxxx"}
    assert "hatched not decided" in axes.get_xlabel()
