"""The report's page on which a case, a norm and h/H are chosen, of the stored results, in Chromium."""

from itertools import pairwise

import numpy as np
import pytest
from conftest import RESULTS, read_stored_table
from selenium.webdriver.support.ui import Select

NORMS = {"h1": "u in H¹", "hm12": "λ in H^(−1/2)", "l2": "λ in L²"}
DRAWN = "return document.getElementById('plot').data.map(of => [of.name, Array.from(of.x), Array.from(of.y)])"

EVERY = """const [cases, norms, ratios] = ["case", "norm", "ratio"].map(id => document.getElementById(id));
const seen = [], text = id => document.getElementById(id).textContent;
for (const a of cases.options) for (const b of norms.options) for (const c of ratios.options) {
  [cases.value, norms.value, ratios.value] = [a.value, b.value, c.value];
  ratios.dispatchEvent(new Event("change"));
  const lines = document.getElementById("plot").data.length;
  seen.push([a.value, b.value, c.value, text("title"), text("said"), lines]);
}
return seen"""
"""Makes every choice, and returns it with what is said and the number of lines drawn then."""


@pytest.fixture
def curves_page(browser):
    """The page, without an error and without a request that leaves this machine."""
    page = browser.open(RESULTS / "report/curves.html")
    assert (page.title, page.errors, page.elsewhere) == ("Errors and rates, to choose from", [], [])
    return browser


def choose(browser, **values):
    """Chooses what is given, by the names of the lists, and returns what is drawn then, by its names."""
    for name, value in values.items():
        Select(browser.driver.find_element("id", name)).select_by_value(value)
    return {name: (np.array(x), np.array(y)) for name, x, y in browser.driver.execute_script(DRAWN)}


def rows(browser, table):
    elements = browser.driver.find_elements("css selector", f"#{table} tr")
    return [[cell.text for cell in row.find_elements("css selector", "th, td")] for row in elements]


def test_the_error_is_drawn_and_falls_with_h(curves_page):
    """The errors of the table, with few digits; the proved rate is a line of slope 1."""
    table = read_stored_table("square/errors").sel(case="natural")
    drawn = choose(curves_page, case="square/natural", norm="h1", ratio="1/2")
    error = drawn["error"][1]
    position = np.isclose(table["h_over_H"].values, 0.5)
    np.testing.assert_allclose(np.sort(error), np.sort(table["h1_error"].values[position]), rtol=1e-3)
    (x, y) = drawn["proved rate 1"]
    assert np.log(y[0] / y[1]) / np.log(x[0] / x[1]) == pytest.approx(1)
    bounds = [drawn[f"guaranteed bound, {kind}"][1] for kind in ("sharp", "cheap")]
    n = len(bounds[0])
    assert (error[:n] <= bounds[0]).all()
    assert (bounds[0] <= bounds[1]).all()


def test_another_case_norm_or_ratio_changes_the_curve_and_the_tables(curves_page):
    """Each of the lists by itself."""
    errors = [choose(curves_page, case="square/natural", norm="h1", ratio="1/2")["error"]]
    tables = [rows(curves_page, "rates")]
    for change in ({"case": "lshape/thirds"}, {"norm": "hm12"}, {"ratio": "1/4"}):
        errors.append(choose(curves_page, **change)["error"])
        tables.append(rows(curves_page, "rates"))
    assert not any(np.array_equal(a[1], b[1]) for a, b in pairwise(errors))
    assert all(a != b for a, b in pairwise(tables))
    assert curves_page.shows("#said", "Observed rate of the expected one")


def test_the_rates_of_pairs_are_those_of_the_table(curves_page):
    choose(curves_page, case="square/thirds", norm="hm12", ratio="1/2")
    item = read_stored_table("square/rates").sel(case="thirds", norm="hm12", h_over_H=0.5)
    head, *body = rows(curves_page, "rates")
    assert head == ["h", "rate", "counts"]
    rates = item["rate"].values[np.isfinite(item["h_coarse"].values)]
    assert [row[1] for row in body] == [f"{rate:.2f}" for rate in rates]
    assert [row[2] for row in body].count("yes") == int(item["asymptotic"].sum())


def test_an_error_in_the_dual_norm_stands_between_its_bounds(curves_page):
    choose(curves_page, case="square/natural", norm="hm12", ratio="1/2")
    head, *body = rows(curves_page, "errors")
    assert head == ["h", "H", "error", "at least", "at most", "sharp bound", "cheap bound"]
    for _, _, error, lower, upper, *_ in body:
        assert 0 < float(lower) <= float(error) <= float(upper)


def test_every_choice_is_drawn_without_an_error(browser):
    """On a phone; also where nothing is judged, and where the error is 0, which is said and not drawn."""
    page = browser.open(RESULTS / "report/curves.html", (390, 844))
    calls = browser.driver.execute_script(EVERY)
    cases = {choice.split("/")[1] for choice, *_ in calls}
    assert {*read_stored_table("square/rates")["case"].values.tolist(), "violates_jjj"} <= cases
    assert len(calls) == 6 * len({choice for choice, *_ in calls}) > 100
    for case, norm, _, title, observed, lines in calls:
        assert title, case
        assert (lines == 0) == ("error 0, as exact" in observed), (case, norm)
    assert page.errors == [entry for entry in browser.driver.get_log("browser") if entry["level"] == "SEVERE"]
    assert browser.overflow() == 0


def test_the_lists_have_names_and_the_picture_a_description(curves_page):
    labels = [
        element.text.splitlines()[0] for element in curves_page.driver.find_elements("css selector", "label")
    ]
    assert labels == ["case, by scene", "norm", "h/H"]
    for norm, name in NORMS.items():
        choose(curves_page, case="square/natural", norm=norm)
        attribute = curves_page.driver.find_element("id", "plot").get_attribute("aria-label")
        assert attribute == f"The error of {name} over h at h/H = 1/2, case natural, on logarithmic axes"
