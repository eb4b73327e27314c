"""`score --html`: one page that holds what is told, and asks for nothing else."""

import re
from dataclasses import replace
from functools import cache
from html.parser import HTMLParser
from math import nan

import pytest
from conftest import discrete, load

from unilateral.discrete.condensed import solve_condensed_problem
from unilateral.exchange.boundary_function import piecewise_constant
from unilateral.exchange.diagnosis import Diagnosis
from unilateral.exchange.exported_folder import ExportedLevel, ForeignSolution
from unilateral.exchange.fault import Fault
from unilateral.exchange.page import render_score_page
from unilateral.exchange.score import Rate, compute_rates, passes_judgement, score_solution, state_verdict

pytestmark = pytest.mark.usefixtures("levels_solved_once")
VERDICT = "reaches the proved rates"
NAMES = ("natural", "no_contact", "rough")


@cache
def score_own_solutions(name, with_multiplier):
    """This project's own solutions on h = 1/8, 1/16 of that case, as if another solver had them."""
    scores = []
    for k, n in enumerate((8, 16)):
        discrete_problem = discrete(name, n, n // 2)
        solved = solve_condensed_problem(discrete_problem)
        mu = piecewise_constant(discrete_problem.partition, solved.lambda_H) if with_multiplier else None
        level = ExportedLevel(f"level_{k}", discrete_problem.mesh, discrete_problem.partition)
        scores.append(
            score_solution(
                load(name).problem, ForeignSolution("file", level, solved.u_h, mu, "constant on cells")
            )
        )
    return scores


def written(name, computed):
    return render_score_page(load(name).problem, computed, compute_rates(load(name).problem, computed))


@cache
def page_of_own_solutions(name, with_multiplier):
    """Drawn once for all tests: its pictures take most of the time."""
    return written(name, score_own_solutions(name, with_multiplier))


class Seen(HTMLParser):
    """Tags, the texts of cells, and whatever an element asks for."""

    def __init__(self, text):
        super().__init__()
        self.tags = []
        self.cells = []
        self.asked = []
        self.open = []
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        self.tags.append(tag)
        if tag not in ("meta", "br"):
            self.open.append(tag)
        self.asked += [
            v for k, v in attributes if k in ("src", "href", "xlink:href", "data") and v[:1] != "#"
        ]

    def handle_startendtag(self, tag, attributes):
        self.handle_starttag(tag, attributes)
        self.handle_endtag(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open and self.open[-1] == "td":
            self.cells.append(data)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("with_multiplier", [True, False])
def test_a_page_is_whole_and_needs_no_network(name, with_multiplier):
    """Also where errors are 0 or NaN, or lambda infinite. A script or a font elsewhere would be asked for."""
    scores = score_own_solutions(name, with_multiplier)
    text = page_of_own_solutions(name, with_multiplier)
    calls = Seen(text)
    assert (calls.open, calls.asked, calls.tags.count("svg")) == ([], [], 2)
    assert not {"script", "link", "iframe", "img"} & set(calls.tags)
    assert not re.search(r"url\((?!#)|@import", text)
    assert f"{scores[-1].errors.h1:.4g}" in calls.cells
    assert ("-" in calls.cells) == (not with_multiplier or name == "rough")
    assert state_verdict(scores, compute_rates(load(name).problem, scores)) in text
    assert "nan" not in calls.cells


def test_where_no_rate_is_proved_the_page_has_none():
    """Control: one that is proved, in the other norms."""
    known_rates = compute_rates(load("natural").problem, score_own_solutions("natural", True))
    cells = Seen(
        render_score_page(
            load("natural").problem,
            score_own_solutions("natural", True),
            known_rates | {"h1": Rate(0.5, 1, 0.7, nan)},
        )
    ).cells
    assert cells[-15:-10] == ["u in H¹", "0.50", "0.70", "-", "no rate is proved"]
    assert cells[-2:] == ["0.5", "reaches the proved rate"]


def test_sides_are_numbered_along_the_boundary():
    """Control: the plots of errors have no such number."""
    errors, boundary = page_of_own_solutions("natural", True).split("Along the boundary")
    assert ("side 0" in errors, "<!-- side 0 -->" in boundary) == (False, True)


def test_a_page_is_the_same_twice():
    """No clock and no random numbers."""
    assert page_of_own_solutions("natural", True) == written("natural", score_own_solutions("natural", True))


def test_faults_and_names_are_told_as_text():
    """Names of files and of levels' folders may hold what HTML takes for markup."""
    score = score_own_solutions("natural", True)[-1]
    image = "<img src=x onerror=alert(1)>"
    diagnosis = Diagnosis([Fault("<lambda, v>", "& more")], [])
    level = replace(score.solution.level, name=image)
    spoilt = replace(
        score, diagnosis=diagnosis, solution=replace(score.solution, file="<b>.csv", level=level)
    )
    text = written("natural", [spoilt])
    in_text = "&lt;img src=x onerror=alert(1)&gt;"
    assert f"<li>&lt;b&gt;.csv: &lt;lambda, v&gt;: &amp; more ({in_text})</li>" in text
    assert f"<td>{in_text}</td>" in text
    assert "img" not in Seen(text).tags
    assert "faults were found" in text


def test_scores_pass_without_faults_and_without_rates_that_fall_short():
    """Nothing wrong, and no rate short of a proved one; a ladder that stays as it is has the rate 0."""
    scores = score_own_solutions("natural", True)
    case = load("natural").problem
    assert passes_judgement(scores, compute_rates(case, scores))
    assert not passes_judgement(
        [replace(scores[0], diagnosis=Diagnosis([Fault("wrong", "")], [])), scores[1]],
        compute_rates(case, scores),
    )
    same = [replace(score, errors=scores[0].errors) for score in scores]
    assert compute_rates(case, same)["h1"].observed == 0
    assert state_verdict(same, compute_rates(case, same)) == "falls short of a proved rate"
    assert not passes_judgement(same, compute_rates(case, same))


def test_the_command_writes_the_page_whole_or_not_at_all(tmp_path, run, refusal):
    """A wrong ending is told before anything is scored, as is a solution that cannot be."""
    folder = tmp_path / "natural"
    solution = tmp_path / "solution.vtu"
    file = tmp_path / "page.html"
    assert run("export", "natural", "--h", "1/8", "--H", "1/4", "--out", folder)[0] == 0
    assert run("solve", "natural", "--h", "1/8", "--H", "1/4", "-o", solution)[0] == 0
    assert ".html" in refusal("score", folder, solution, "--html", tmp_path / "page.pdf")
    refusal("score", folder, tmp_path / "none.vtu", "--html", file)
    assert not file.exists()
    code, out, _ = run("score", folder, solution, "--html", file)
    assert code == 0
    assert re.search(rf"^  written: {re.escape(str(file))}, \S+ kB$", out, re.MULTILINE)
    assert "no fault was found" in file.read_text()


def test_chromium_shows_it_without_errors_and_without_a_network(browser, tmp_path):
    """As a reader sees it: both pictures have a height, and nothing is asked for elsewhere."""
    (tmp_path / "page.html").write_text(page_of_own_solutions("natural", True))
    calls = browser.open(tmp_path / "page.html")
    assert (calls.title, calls.errors, calls.elsewhere) == ("natural: " + VERDICT, [], [])
    assert len(calls.requested) == 1
    assert [height > 100 for height in browser.heights("svg")] == [True, True]
    assert browser.overflow() == 0
