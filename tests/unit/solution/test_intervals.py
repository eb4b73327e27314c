"""What is said of an interval, wherever one is written: the ends that are known, guaranteed only if one is.

All combinations of ends that are finite, infinite or NaN are put into everything that prints one: Python,
the command line, pages and JSON.
"""

import itertools
import json
import math
import re

import pytest

import unilateral as ul
from unilateral.bounds.forces import Force
from unilateral.cli import report
from unilateral.formulas.decimals import format_interval, interval_record
from unilateral.norms.dual import Errors
from unilateral.solution import interactive, plot_data, summary
from unilateral.solution.bounds import Bounds
from unilateral.solution.forces import Forces
from unilateral.solution.solution import Solution
from unilateral.system import json_records

SQUARE = [(0, 0), (1, 0), (1, 1), (0, 1)]
ENDS = [
    (lower, upper)
    for lower, upper in itertools.product(
        (-math.inf, -1.5, 0.0, 1.25, math.inf, math.nan), (-math.inf, 1.75, math.inf, math.nan)
    )
]
VALUES = (1.5, math.nan, math.inf)
ALL = [(value, *ends) for value in VALUES for ends in ENDS]
NUMBER = r"-?[0-9.]+(?:e[+-][0-9]+)?"


def wrong(text, value, lower, upper):
    """What a text says of an interval that is not so; the words are looked for one by one."""
    computed = []
    has_lower = math.isfinite(lower)
    has_upper = math.isfinite(upper)
    if ("guaranteed" in text) != (has_upper or (has_lower and lower != 0)):
        computed.append("guaranteed")
    if re.search(r"\b(nan|inf)\b", text):
        computed.append("a number that is none")
    values = [math.nan, math.nan]
    if match := re.search(rf"between ({NUMBER}) and ({NUMBER})", text):
        values = [float(end) for end in match.groups()]
    elif match := re.search(rf"({NUMBER}) ± ({NUMBER})", text):
        middle, apart = map(float, match.groups())
        if not (has_lower and has_upper and middle - apart <= lower <= upper <= middle + apart):
            computed.append("±")
        values = [lower, upper]
    if match := re.search(rf"at least ({NUMBER})", text):
        values[0] = float(match[1])
    if match := re.search(rf"at most ({NUMBER})", text):
        values[1] = float(match[1])
    single = has_lower and lower == 0 and not has_upper
    for name, end, number in (("lower", lower, values[0]), ("upper", upper, values[1])):
        expected = math.isfinite(end) and not (single and name == "lower")
        if expected != math.isfinite(number) or (expected and not math.isclose(end, number)):
            computed.append(name)
    return computed


@pytest.fixture(scope="module")
def solution():
    return ul.solve(ul.Problem(SQUARE, f=-1, g="-1/10", u={3: 0}, c=0), h=1 / 4, H=1 / 2)


@pytest.fixture
def places(solution, monkeypatch):
    """All that prints a force, by the names of the places."""
    monkeypatch.setattr(summary, "_embed_picture", lambda _: "")
    drawn = plot_data.collect_plot_data(solution)
    certificate = solution.certificate()

    def texts(force):
        monkeypatch.setattr(Solution, "force", lambda self, sharp=False, sides=None: force)
        none = dict.fromkeys(("iterations", "hm12_algebraic_bound", "h1_error"), math.nan)
        computed = certificate | none | {"algebraic_bound": math.nan, "seconds": 0.0, "peak_mb": 0.0}
        row = report.ForceRow("side_1", "force, side 1", force)
        table = report.format_result(computed, None, {}, [row], "", solution.problem)
        return {
            "Force": repr(force),
            "Forces": repr(Forces(force, [force, Force(0.0, 0.0, math.inf)])).partition(" on sides")[0],
            "reaction": repr(Forces(Force(2.0, 0.0, math.inf), [], {(3,): force})).rpartition("side 3:")[2],
            "summary": summary.collect_summary_rows(solution)["force"],
            "notebook": re.search(r"<th>force</th><td>(.*?)</td>", summary.render_summary_html(solution))[1],
            "page": plot_data.describe_force(solution, drawn),
            "command": re.search("force, side 1 (.*)", table)[1] + ", guaranteed" * has_end(force),
        }

    return texts


def has_end(force):
    """Whether an end is known. Rows of the command lack the word; the docs say what they are."""
    _, lower, upper = force
    return math.isfinite(upper) or (math.isfinite(lower) and lower != 0)


def test_each_place_says_the_ends_that_are_known(places):
    for force in ALL:
        for place, text in places(Force(*force)).items():
            assert wrong(text, *force) == [], (place, force, text)


def test_what_was_printed_once_is_found_to_be_wrong():
    """The check can fail: these are claims without a bound."""
    assert wrong("0.9668, at least 0; guaranteed", 0.9668, 0.0, math.inf) == ["guaranteed", "lower"]
    assert wrong("nan, at least -inf; guaranteed", math.nan, -math.inf, math.inf)
    assert wrong("0.4857, at least -inf", 0.4857, -math.inf, 0.5549) == [
        "guaranteed",
        "a number that is none",
        "upper",
    ]
    assert wrong("1.5 ± 0.1, guaranteed", 1.5, 1.25, 1.75) == ["±"]
    assert wrong("1.5, between 1.25 and 1.75", 1.5, 1.25, 1.75) == ["guaranteed"]
    assert wrong("1.50 ± 0.25, guaranteed", 1.5, 1.25, 1.75) == []


def test_forces_say_guaranteed_once_only_if_all_have_bounds():
    known_force = Force(1.0, 0.75, 1.25)
    unknown = Force(2.0, 0.0, math.inf)
    assert (
        repr(Forces(known_force, [known_force])) == "Forces: 1.00 ± 0.25; on sides 0: 1.00 ± 0.25; guaranteed"
    )
    total = repr(Forces(known_force, [known_force], {}, Force(1.0, -math.inf, math.inf)))
    assert total.endswith("sum of forces and reactions: 1, no bound")
    assert repr(Forces(unknown, [known_force, unknown], {(1,): Force(math.nan, -math.inf, math.inf)})) == (
        "Forces: 2, no upper bound; on sides 0: 1.00 ± 0.25, guaranteed; reaction on side 1: unknown"
    )


def test_bounds_on_errors_say_nothing_where_they_are_infinite(solution, monkeypatch):
    certificate = solution.certificate()
    for u, multiplier in itertools.product((0.5, math.inf), (0.25, math.inf, math.nan)):
        bounds = Bounds(u, multiplier, 0.0)
        for module in ("solution", "forces"):
            name = f"unilateral.solution.{module}.bound_errors"
            monkeypatch.setattr(name, lambda solution, sharp, bounds=bounds: bounds)
        finite = math.isfinite(u) and not math.isinf(multiplier)
        assert ("guaranteed" in repr(bounds)) == finite
        rows = summary.collect_summary_rows(solution)
        assert ("guaranteed" in rows["error of u"]) == math.isfinite(u)
        assert ("guaranteed" in rows["error of lambda"]) == math.isfinite(multiplier)
        for text in (repr(bounds), *rows.values()):
            assert not re.search(r"\b(nan|inf)\b", text)
        computed = certificate | {"forces": None, "seconds": 0.0, "peak_mb": 0.0}
        table = report.format_result(computed, bounds, {"h1": 0.0, "hm12": 0.0}, [], "", solution.problem)
        assert ("\n  guaranteed  " in table) == math.isfinite(u)
        assert ("\n  also guaranteed  " in table) == math.isfinite(multiplier)
    assert repr(Errors(0.1, math.nan, math.nan, 0.3)) == (
        "Errors: ||u - u_h||_1 = 0.1, ||lambda - lambda_H||_-1/2 unknown, in L2 0.3"
    )


def test_json_has_null_for_an_end_that_is_not_known_and_says_which_is():
    for value, lower, upper in ALL:
        document = json.loads(json_records.encode_json(interval_record(value, lower, upper)))
        assert list(document) == ["value", "lower", "upper", "known"]
        for name, number in (("value", value), ("lower", lower), ("upper", upper)):
            assert document[name] == (number if math.isfinite(number) else None)
        ends = [name for name in ("lower", "upper") if document[name] is not None]
        assert document["known"] == {0: None, 1: "".join(ends), 2: "both"}[len(ends)]


def test_values_and_ends_are_in_any_format():
    assert format_interval(1, 2, 1.5, ".2e") == "1.50e+00, between 1.00e+00 and 2.00e+00"
    assert format_interval(-math.inf, 2, math.inf, ".1f") == "at most 2.0"


def test_the_page_has_no_force_without_bounds(solution):
    assert "∫λ" in interactive.render_solution_page(solution)
