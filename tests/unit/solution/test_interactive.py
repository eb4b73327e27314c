"""The page on which a solution is turned and zoomed: what the file holds, and what Chromium shows of it."""

import base64
import io
import json
import re

import numpy as np
import pytest
from conftest import ROOT
from matplotlib.image import imread

import unilateral as ul
from unilateral.formulas.decimals import format_interval
from unilateral.geometry.polygon import square
from unilateral.geometry.structured import make_structured_mesh
from unilateral.solution import interactive, plot_data
from unilateral.solution.contact import describe_certain_arcs
from unilateral.solution.node_clusters import cluster_nodes

SQUARE = [(0, 0), (1, 0), (1, 1), (0, 1)]
RED = np.array([214, 39, 40]) / 255
"""The colour of contact."""
WITHOUT_WEBGL = """const of = HTMLCanvasElement.prototype.getContext;
HTMLCanvasElement.prototype.getContext = function (kind, ...more) {
  return kind.startsWith("webgl") ? null : of.call(this, kind, ...more);
}"""


@pytest.fixture(scope="module")
def solution():
    """With contact, a gap and free sides on which a flux is given."""
    side_data = {"g": ["x/10 - 1/10", None, 0, None], "free_sides": [1, 3], "q": [None, "4*y", None, -3]}
    return ul.solve(ul.Problem(SQUARE, f=-1, name="a <b>bold<b> & plain", **side_data), accuracy=0.1)


@pytest.fixture(scope="module")
def page(solution, tmp_path_factory):
    path = tmp_path_factory.mktemp("page") / "solution.html"
    solution.save(path)
    return path


def data(path, name):
    """What the file holds of a picture."""
    text = path.read_text(encoding="utf-8")
    (json_text,) = re.findall(
        rf'<script type="application/json" id="{name}-data">(.*?)</script>', text, re.DOTALL
    )
    return json.loads(json_text)


def traces(path, name):
    """The traces of a picture in the file, by their names, with plain arrays."""
    traces_of_picture = data(path, name)["data"]
    return {
        trace.get("name", trace["type"]): {key: array(value) for key, value in trace.items()}
        for trace in traces_of_picture
    }


def array(value):
    if isinstance(value, dict) and "bdata" in value:
        return np.frombuffer(base64.b64decode(value["bdata"]), np.dtype(value["dtype"]))
    return value


def test_the_data_in_the_file_are_those_of_the_solution(solution, page):
    """Bit by bit: nodes, triangles, u_h, lambda_H and the gap."""
    surface = traces(page, "surface")
    along = traces(page, "boundary")
    mesh = surface["mesh3d"]
    np.testing.assert_array_equal(np.column_stack([mesh["x"], mesh["y"]]), solution.mesh.points)
    np.testing.assert_array_equal(np.column_stack([mesh["i"], mesh["j"], mesh["k"]]), solution.mesh.triangles)
    np.testing.assert_array_equal(mesh["z"], solution.u)
    flux = along["λ<sub>H</sub>"]
    for i, ends in enumerate((flux["x"][::2], flux["x"][1::2])):
        np.testing.assert_array_equal(ends, solution.partition.points[i : i - 1 or None])
    np.testing.assert_array_equal(flux["y"], np.repeat(solution.multiplier, 2))
    np.testing.assert_array_equal(flux["customdata"], np.repeat(solution.partition.side, 2))
    gap = np.where(solution.multiplier > 0, 0, solution.gap)
    np.testing.assert_allclose(along["mean of u<sub>h</sub> − g"]["y"], np.repeat(gap, 2), atol=1e-6)
    assert np.nanmin(along["given flux q"]["y"]) == pytest.approx(-3)


def test_the_lines_of_contact_and_obstacle_lie_on_the_boundary(solution, page):
    """u_h along the contact is that of `u_at`; beside it the mean of g is that of x/10 - 1/10, by hand."""
    lines = traces(page, "surface")
    x = np.asarray(lines["contact"]["x"], dtype=float)
    y = np.asarray(lines["contact"]["y"], dtype=float)
    z = np.asarray(lines["contact"]["z"], dtype=float)
    finite = np.isfinite(x)
    np.testing.assert_allclose(
        z[finite], solution.u_at(np.column_stack([x, y])[finite]), rtol=1e-12, atol=1e-15
    )
    assert np.count_nonzero(~finite) == len(solution.contact.intervals) > 0
    (name,) = [line for line in lines if line.startswith("obstacle")]
    x = np.asarray(lines[name]["x"], dtype=float)
    y = np.asarray(lines[name]["y"], dtype=float)
    z = np.asarray(lines[name]["z"], dtype=float)
    bottom = (y[::2] == 0) & (y[1::2] == 0) & np.isfinite(z[::2])
    assert bottom.any()
    np.testing.assert_allclose(z[::2][bottom], ((x[::2] + x[1::2]) / 20 - 0.1)[bottom], rtol=1e-9, atol=1e-12)


def test_a_solution_has_the_same_page_every_time(solution, page):
    """And it names nothing of the machine or the time."""
    assert interactive.render_solution_page(solution) == page.read_text(encoding="utf-8")


def test_what_is_guaranteed_stands_on_the_page(solution, page):
    """The force and its limits with four digits, from the solution itself; the title is no HTML."""
    text = page.read_text(encoding="utf-8")
    assert "<h1>a &lt;b&gt;bold&lt;b&gt; &amp; plain</h1>" in text
    assert re.search(r"<p>Error of u in H¹: at most [\d.]+ %, guaranteed\.</p>", text)
    full = solution.forces().whole
    result = re.search(r"∫λ: (\S+), between (\S+) and (\S+), guaranteed", text)
    value, lower, upper = map(float, result.groups())
    assert value == pytest.approx(full.value, rel=1e-3)
    assert lower <= full.lower <= full.upper <= upper
    assert (lower, upper) == pytest.approx((full.lower, full.upper), rel=1e-3)
    function = ul.solve(ul.Problem(SQUARE, f=lambda x, y: -x, g=0), h=1 / 8, H=1 / 4)
    text = interactive.render_solution_page(function)
    assert "There is no gap: in contact everywhere." in text
    result = (
        r"<p>Error of u in H¹: at most \S+( %)?, guaranteed; f linear between the nodes of the mesh\.</p>"
    )
    assert re.search(result, text)


def test_a_mesh_with_too_many_triangles_is_drawn_coarser(monkeypatch, tmp_path):
    """Nodes and values are the mesh's own, the surface still covers the domain, and the page says so."""
    s = ul.solve(ul.load(ROOT / "examples/cog.yaml"), accuracy=0.1)
    monkeypatch.setattr(plot_data, "MAX_SURFACE_TRIANGLES", 1000)
    s.save(tmp_path / "coarse.html")
    mesh = traces(tmp_path / "coarse.html", "surface")["mesh3d"]
    n = len(mesh["i"])
    assert 200 < n <= 1000 < len(s.mesh.triangles)
    text = f"drawn coarser than the mesh: with {n} triangles in place of {len(s.mesh.triangles)}."
    assert text in (tmp_path / "coarse.html").read_text(encoding="utf-8")
    np.testing.assert_allclose(mesh["z"], s.u_at(np.column_stack([mesh["x"], mesh["y"]])), rtol=1e-12)
    monkeypatch.undo()
    s.save(tmp_path / "fine.html")
    assert "coarser" not in (tmp_path / "fine.html").read_text(encoding="utf-8").partition("<script>")[0]


@pytest.mark.parametrize("maximum", [500, 2000])
def test_a_coarser_surface_covers_the_domain(maximum):
    """On the square, whose corners stay: the triangles' areas sum up to 1, and no triangle is there twice."""
    mesh = make_structured_mesh(square(), 1 / 64)
    nodes, triangles = cluster_nodes(mesh, maximum)
    assert maximum / 4 < len(triangles) <= maximum < len(mesh.triangles)
    points = mesh.points[nodes]
    assert {tuple(point) for point in points.tolist()} >= {(float(x), float(y)) for x, y in SQUARE}
    a, b, c = points[triangles].transpose(1, 2, 0)
    (x, y) = b - a
    (z, w) = c - a
    assert (0.5 * (x * w - y * z)).sum() == pytest.approx(1, rel=0.02)
    assert len({tuple(sorted(triangle)) for triangle in triangles.tolist()}) == len(triangles)
    same, full = cluster_nodes(mesh, len(mesh.triangles))
    np.testing.assert_array_equal(same, np.arange(mesh.n_nodes))
    assert full is mesh.triangles


def colours(browser):
    """The picture of the surface, (height, width, 3) with colours between 0 and 1."""
    element = browser.driver.find_element("css selector", "#surface")
    return imread(io.BytesIO(element.screenshot_as_png))[..., :3]


def count_red_pixels(picture):
    """How many places are as red as contact."""
    return np.count_nonzero(np.abs(picture - RED).max(axis=2) < 0.1)


@pytest.mark.parametrize("size", [(1280, 900), (390, 844)])
def test_the_page_is_drawn_without_errors_and_without_a_network(browser, page, size):
    """A desk's and a phone's window. WebGL by the processor, and 5 MB of script, take some seconds."""
    opened = browser.open(page, size)
    assert (opened.title, opened.errors, opened.elsewhere) == ("a <b>bold<b> & plain", [], [])
    assert browser.overflow() == 0
    assert browser.shows("#boundary", "given flux q")
    picture = colours(browser)
    assert count_red_pixels(picture) > 100
    assert len(np.unique((16 * picture).astype(int).reshape(-1, 3), axis=0)) > 50
    assert not browser.driver.find_elements("css selector", ".modebar")  # whose buttons send data elsewhere


def test_buttons_turn_the_surface(browser, page):
    """By the keyboard, which reaches them in order; `reset` brings the first view back."""
    browser.open(page)
    eye = "return document.getElementById('surface').layout.scene.camera.eye"
    first = browser.driver.execute_script(eye)
    buttons = {
        element.text: element for element in browser.driver.find_elements("css selector", "#views button")
    }
    calls = {}
    for name in ("turn left", "tilt up", "nearer", "from above", "reset"):
        buttons[name].send_keys("\n")
        calls[name] = np.array([browser.driver.execute_script(eye)[axis] for axis in "xyz"])
    x = first["x"]
    y = first["y"]
    z = first["z"]
    turned = calls["turn left"]
    angle = np.radians(15)
    expected = [x * np.cos(angle) + y * np.sin(angle), y * np.cos(angle) - x * np.sin(angle), z]
    np.testing.assert_allclose(turned, expected, rtol=1e-9)
    assert calls["tilt up"][2] > z
    assert np.linalg.norm(calls["nearer"]) == pytest.approx(0.8 * np.linalg.norm([x, y, z]))
    assert calls["from above"][2] > 50 * np.hypot(*calls["from above"][:2])
    np.testing.assert_allclose(calls["reset"], [x, y, z], rtol=1e-12)


def test_a_screen_reader_is_told_what_is_shown(browser, page):
    browser.open(page)
    assert browser.driver.execute_script("return document.documentElement.lang") == "en"
    pictures = browser.driver.find_elements("css selector", "[role=img]")
    attributes = [picture.get_attribute("aria-label") for picture in pictures]
    assert len(attributes) == 2
    assert re.match(
        r"The solution u_h as a surface over the domain, between \S+ and \S+; contact", attributes[0]
    )


def test_without_webgl_a_sentence_stands_in_place_of_the_surface(browser, page):
    """And the curves along the boundary are still drawn."""
    command = "Page.addScriptToEvaluateOnNewDocument"
    script = browser.driver.execute_cdp_cmd(command, {"source": WITHOUT_WEBGL})["identifier"]
    try:
        opened = browser.open(page)
    finally:
        browser.driver.execute_cdp_cmd("Page.removeScriptToEvaluateOnNewDocument", {"identifier": script})
    assert (opened.errors, opened.elsewhere) == ([], [])
    assert browser.shows("#surface", "The surface needs WebGL, which this browser does not have")
    assert browser.shows("#boundary", "given flux q")
    assert count_red_pixels(colours(browser)) == 0
    assert not browser.driver.find_element("css selector", "#views").is_displayed()


def test_clamped_sides_are_hatched_outside(tmp_path):
    """At the height of u there, which is x/2 and 0; control: without such sides there is no such line."""
    problem = ul.Problem(SQUARE, -1, [None, -1, None, None], [2], u={0: "x/2", 3: 0}, c=0)
    s = ul.solve(problem, h=1 / 8, H=1 / 4)
    s.save(tmp_path / "clamped.html")
    line = traces(tmp_path / "clamped.html", "surface")["clamped"]
    x = np.asarray(line["x"], dtype=float)
    y = np.asarray(line["y"], dtype=float)
    z = np.asarray(line["z"], dtype=float)
    breaks = np.flatnonzero(np.isnan(x))
    assert len(breaks) == 2
    for component, across, height in (
        (slice(0, breaks[0]), y, x / 2),
        (slice(breaks[0] + 1, breaks[1]), x, 0 * x),
    ):
        feet = across[component][0::3]
        tips = across[component][1::3]
        assert len(tips) == len(feet) > 10
        np.testing.assert_allclose(feet, 0, atol=1e-12)
        assert np.all(tips < -0.01)
        np.testing.assert_allclose(z[component][0::3], height[component][0::3], atol=1e-12)
        np.testing.assert_array_equal(z[component][0::3], z[component][1::3])
    texts = [
        annotation["text"]
        for annotation in data(tmp_path / "clamped.html", "boundary")["layout"]["annotations"]
    ]
    assert [text for text in texts if text == "clamped"] == ["clamped"] * 4


def test_without_clamped_sides_no_line_is_called_so(page):
    assert "clamped" not in traces(page, "surface")
    assert "clamped" not in [
        annotation["text"] for annotation in data(page, "boundary")["layout"]["annotations"]
    ]


def test_forces_and_reactions_stand_on_the_page_with_their_bounds():
    """Those of `forces`, each side by its number; beside them what is certain of contact, and its length."""
    sides = [0, None, None, None]
    for f in (-4, lambda x, y: 0 * x - 4):
        s = ul.solve(ul.Problem(SQUARE, f, sides, free_sides=[1, 2], u={3: 0.5}), h=1 / 8, H=1 / 4)
        cells = "<tr><th>(.*?)</th><td>(.*?)</td><td>(.*?)</td><td>(.*?)</td></tr>"
        rows = re.findall(cells, interactive.render_solution_page(s))
        names, intervals, certain, lengths = zip(*rows, strict=True)
        assert names == ("force, side 0", "reaction, side 3")
        assert certain == (describe_certain_arcs(s.contact.certain), "")
        assert lengths == (f"{s.contact.length:.4g} of 1", "")
        for text, force in zip(intervals, (s.forces().sides[0], s.forces().reactions[3,]), strict=True):
            lower = force.lower
            upper = force.upper
            value = force.value
            assert text == format_interval(lower, upper, value) + ", guaranteed"


def test_sides_have_their_numbers_in_both_pictures():
    s = ul.solve(ul.Problem(SQUARE, -1, 0), h=1 / 8, H=1 / 4)
    collected = plot_data.collect_plot_data(s)
    numbers = interactive.draw_surface(collected).data[-1]
    assert (numbers.mode, list(numbers.text)) == ("text", ["0", "1", "2", "3"])
    places = np.column_stack([numbers.x, numbers.y])
    middles = s.polygon.at(np.arange(4), s.polygon.lengths / 2)
    assert np.all(np.sum((places - middles) * s.polygon.normals, axis=1) > 0)
    np.testing.assert_allclose(places, middles, atol=0.05)
    named = [annotation.text for annotation in interactive.draw_boundary_graphs(collected).layout.annotations]
    assert named == ["side 0", "1", "2", "3"]
