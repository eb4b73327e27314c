"""What objects print of themselves: little, quickly, and no more than is guaranteed."""

import base64
import json
import re
import warnings
from xml.etree import ElementTree

import numpy as np
import pytest
from conftest import ROOT

import unilateral as ul
from unilateral.discrete.solution import DiscreteSolution
from unilateral.problems.fields import as_html
from unilateral.solution import summary
from unilateral.solution.interactive import render_solution_page

pytestmark = pytest.mark.usefixtures("shared_cases")

SQUARE = [(0, 0), (1, 0), (1, 1), (0, 1)]
SIZES = {"h": 1 / 16, "H": 1 / 8}


@pytest.fixture(scope="module")
def cog():
    return ul.solve(ul.load(ROOT / "examples/cog.yaml"), accuracy=0.1)


@pytest.fixture
def functions():
    return ul.Problem(SQUARE, f=lambda x, y: x - 2, g=["-x", -1, None, 0], free_sides=[2])


def test_a_solution_prints_what_is_known_of_it(cog):
    """The percentage is that of the certificate, rounded up; the rest are the attributes."""
    lines = repr(cog).splitlines()
    assert lines[0].startswith("Solution of 'cog': a membrane in the shape of a cog")
    rows = dict(re.split(r"\s{2,}", line.strip(), maxsplit=1) for line in lines[1:])
    assert rows["unknowns"] == f"{cog.mesh.n_nodes}, and {cog.partition.n_cells} multipliers"
    pattern = r"at most (\S+), (\S+) % of \|\|u\|\|_1, guaranteed"
    bound, percent = re.fullmatch(pattern, rows["error of u"]).groups()
    assert cog.bounds.u <= float(bound) <= 1.01 * cog.bounds.u
    assert 100 * cog.bounds.relative_u <= float(percent) <= 10
    assert rows["contact"].startswith(f"computed: {cog.contact.length:.4g} of ")


def test_a_printed_force_has_the_guaranteed_interval_inside(cog):
    force = cog.forces().whole
    value, apart = map(float, re.search(r"(\S+) ± (\S+), guaranteed", repr(cog)).groups())
    assert value - apart <= force.lower < force.upper <= value + apart
    assert 2 * apart <= 1.3 * (force.upper - force.lower)


@pytest.mark.parametrize(("name", "exact"), [("shelf", 2.0), ("seal", 12.0)])
def test_the_sum_of_all_forces_is_shown_wherever_forces_are(name, exact, run, tmp_path):
    """-f times the area: the shelf has 1 * 2, the seal 50 * 0.24. Control: with c = 1 nothing says a sum."""
    file = ROOT / f"examples/{name}.yaml"
    second = tmp_path / "other.yaml"
    second.write_text(re.sub(r"\nc: 0", "\nc: 1", file.read_text()))
    for problem in (file, second):
        s = ul.solve(ul.load(problem), accuracy=0.2)
        table = run("solve", problem, "--accuracy", "0.2")[1]
        record = run("solve", problem, "--accuracy", "0.2", "--json")[1]
        expected_texts = {
            "Python": re.search("sum of forces and reactions: (.*);", repr(s.forces())),
            "summary": re.search("with reactions   (.*), guaranteed", repr(s)),
            "notebook": re.search("<th>with reactions</th><td>(.*?), guaranteed</td>", s._repr_html_()),
            "page": re.search(
                "<th>sum of forces, reactions</th><td>(.*?), guaranteed</td>", render_solution_page(s)
            ),
            "command": re.search("sum of forces, reactions +(.*)", table),
        }
        computed = json.loads(record)["forces"].get("forces_and_reactions")
        if problem == second:
            assert [*expected_texts.values(), computed] == [None] * 6
            continue
        assert computed["lower"] <= exact <= computed["upper"]
        assert computed["value"] == pytest.approx(exact, rel=1e-12)
        for place, text in expected_texts.items():
            value, apart = map(float, text[1].split(" ± "))
            assert (place, value) == (place, pytest.approx(exact, rel=1e-12))
            assert apart < 1e-8 * exact


def test_all_that_users_meet_prints_little(cog, functions):
    """At most 400 characters; control: what a mesh holds has many more."""
    problems = [ul.case("natural"), functions, cog.problem, ul.load(ROOT / "examples/plate.yaml"), ul.Stop()]
    components = [
        cog,
        cog.mesh,
        cog.partition,
        cog.polygon,
        cog.contact,
        cog.bounds,
        cog.search,
        cog.problem,
        ul.Solver("natural", h=1 / 4, H=1 / 2).matrices(),
    ]
    components += [cog.solved, cog.search.best, cog.forces(), cog.forces().whole]
    components += cog.contact.intervals[:1]
    for thing in [*problems, *components, ul.solve("natural", **SIZES).errors]:
        assert 15 < len(repr(thing)) < 400
        assert "array(" not in repr(thing)
    assert len(repr(vars(cog.mesh))) > 1000


def test_problems_print_their_fields(functions):
    fields = {"f": "x - 1", "g": ["-x", -1, None, 0], "free_sides": [2], "q": 3, "k": "1/3"}
    assert repr(ul.Problem(SQUARE, **fields, name="mine")) == (
        "Problem 'mine'; polygon = 4 sides, area 1, f = x - 1, g = [-x, -1, 0], k = 1/3, "
        "free sides = 2, q = 3"
    )
    assert repr(functions).endswith("f = a function, g = [-x, -1, 0], free sides = 2")
    assert "<td>x &lt; 0</td>" in as_html("head", {"f": "x < 0"})
    for problem in (functions, ul.case("natural"), ul.load(ROOT / "examples/cog.yaml")):
        ElementTree.fromstring(problem._repr_html_())


def test_a_notebook_shows_the_table_and_the_picture(cog):
    """One element of HTML with the rows of the text, and an image that is an SVG."""
    page = ElementTree.fromstring(re.sub(r"(<img [^>]*)>", r"\1/>", cog._repr_html_()))
    texts = {row.find("th").text: row.find("td").text for row in page.iter("tr")}
    assert texts == summary.collect_summary_rows(cog)
    kind, drawn = page.find("img").attrib["src"].split(",")
    assert kind == "data:image/svg+xml;base64"
    assert ElementTree.fromstring(base64.b64decode(drawn)).tag.endswith("svg")
    assert page.find("img").attrib["alt"]


def test_without_matplotlib_there_is_the_table_alone(cog, monkeypatch):
    monkeypatch.setattr(summary, "find_spec", lambda name: None)
    page = cog._repr_html_()
    assert "<img" not in page
    assert "<table>" in page


def test_nothing_that_takes_long_is_begun(monkeypatch):
    """On a mesh with more than QUICK nodes no bound and no picture; control: a known bound is shown."""
    monkeypatch.setattr(summary, "MAX_NODES_FOR_SUMMARY", 100)
    s = ul.solve("natural", **SIZES)
    with monkeypatch.context() as forbidden:
        forbidden.setattr(DiscreteSolution, "bound", None)
        for page in (repr(s), s._repr_html_()):
            assert "not bounded yet: see bounds" in page
            assert "guaranteed" not in page
            assert "<img" not in page
    assert s.bounds.u > 0
    assert "guaranteed" in repr(s)


def test_printing_warns_of_nothing_and_tells_what_is_unsure(functions, monkeypatch):
    with warnings.catch_warnings(action="ignore", category=ul.SolutionWarning):
        same = ul.solve("natural", h=1 / 8, H=1 / 8)
        early = ul.solve("natural", **SIZES, stop=ul.Stop(algorithm="uzawa", max_steps=3))
    with warnings.catch_warnings(action="error"):
        assert "lambda_H         may not be unique" in repr(same)
        assert "not converged    the algebraic error is at most " in repr(early)
        assert "f                linear between the nodes of the mesh" in repr(ul.solve(functions, **SIZES))
        monkeypatch.setattr("unilateral.solution.bounds.available_mb", lambda: 0.0)
        assert "not bounded yet: see bounds" in repr(ul.solve("natural", **SIZES))


def test_the_printed_length_of_contact_is_the_whole_boundary_or_0():
    """By hand: g above f everywhere presses u onto g; g far below leaves u alone."""
    full = ul.solve(ul.Problem(SQUARE, f=0, g=1), **SIZES)
    none = ul.solve(ul.Problem(SQUARE, f=0, g=-1), **SIZES)
    assert "contact          computed: the whole boundary, 4 of 4" in repr(full)
    assert "contact          computed: 0 of 4" in repr(none)
    assert np.all(none.multiplier == 0)


def test_a_linear_problem_has_no_row_of_lambda_and_of_no_force():
    """No side carries contact; its error of u is bounded all the same."""
    rows = summary.collect_summary_rows(
        ul.solve(ul.Problem(SQUARE, f="x", g=None, free_sides=[0, 1, 2, 3]), **SIZES)
    )
    assert rows["contact"] == summary.LINEAR_PROBLEM_NOTE
    assert set(rows) == {"polygon", "unknowns", "error of u", "contact"}
    assert "guaranteed" in rows["error of u"]


def test_a_bound_as_large_as_the_solution_is_no_percentage_of_it():
    """f has four waves to a side, and the mesh four edges: nothing is known of the norm of u."""
    s = ul.solve(ul.Problem(SQUARE, f="300*sin(8*pi*x)*sin(8*pi*y)", g=-1), h=1 / 4, H=1 / 2)
    assert not s.bounds.relative_u < 1
    row = summary.collect_summary_rows(s)["error of u"]
    assert "%" not in row
    assert re.match(r"at most \S+", row)


def test_a_search_for_a_sharp_bound_prints_that():
    """It is below the cheap one, and printed up to three digits."""
    s = ul.solve("natural", accuracy=0.2, sharp=True)
    assert s.sharp_bounds.u < 0.999 * s.bounds.u
    printed = float(re.search(r"at most (\S+),", summary.collect_summary_rows(s)["error of u"])[1])
    assert s.sharp_bounds.u <= printed <= 1.01 * s.sharp_bounds.u


def test_a_solution_lists_what_users_are_told_of(cog):
    """The attributes that docs/python.md has in its table and below it, and none that serve other modules.

    Control: one of the latter is there, and not listed.
    """
    page = (ROOT / "docs/python.md").read_text(encoding="utf-8")
    table = page.partition("It has these attributes")[2].partition("\n\n`s.save`")[0]
    names = set(re.findall(r"`(\w+)[^`]*`", "".join(re.findall(r"^\| (`.*?) \|", table, re.MULTILINE))))
    listed = {name for name in dir(cog) if not name.startswith("_")}
    assert names <= listed
    assert [name for name in sorted(listed) if not re.search(rf"\b{name}\b(?=[^`\n]*`)", page)] == []
    assert hasattr(cog, "bounded")
    assert "bounded" not in listed
