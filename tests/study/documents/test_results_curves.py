"""The report's page on which a case, a norm and h/H are chosen, of the stored results, in Chromium."""

from itertools import pairwise

import numpy as np
import pytest
from conftest import RESULTS, stored
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
def opened(browser):
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
    found = browser.driver.find_elements("css selector", f"#{table} tr")
    return [[cell.text for cell in row.find_elements("css selector", "th, td")] for row in found]


def test_the_error_is_drawn_and_falls_with_h(opened):
    """The errors of the table, with few digits; the proved rate is a line of slope 1."""
    table = stored("square/errors").sel(case="natural")
    drawn = choose(opened, case="square/natural", norm="h1", ratio="1/2")
    error = drawn["error"][1]
    at = np.isclose(table["h_over_H"].values, 0.5)
    np.testing.assert_allclose(np.sort(error), np.sort(table["h1_error"].values[at]), rtol=1e-3)
    (x, y) = drawn["proved rate 1"]
    assert np.log(y[0] / y[1]) / np.log(x[0] / x[1]) == pytest.approx(1)
    bounds = [drawn[f"guaranteed bound, {kind}"][1] for kind in ("sharp", "cheap")]
    n = len(bounds[0])
    assert (error[:n] <= bounds[0]).all()
    assert (bounds[0] <= bounds[1]).all()


def test_another_case_norm_or_ratio_changes_the_curve_and_the_tables(opened):
    """Each of the lists by itself."""
    seen = [choose(opened, case="square/natural", norm="h1", ratio="1/2")["error"]]
    tables = [rows(opened, "rates")]
    for change in ({"case": "lshape/thirds"}, {"norm": "hm12"}, {"ratio": "1/4"}):
        seen.append(choose(opened, **change)["error"])
        tables.append(rows(opened, "rates"))
    assert not any(np.array_equal(a[1], b[1]) for a, b in pairwise(seen))
    assert all(a != b for a, b in pairwise(tables))
    assert opened.shows("#said", "Observed rate of the expected one")


def test_the_rates_of_pairs_are_those_of_the_table(opened):
    choose(opened, case="square/thirds", norm="hm12", ratio="1/2")
    of = stored("square/rates").sel(case="thirds", norm="hm12", h_over_H=0.5)
    head, *body = rows(opened, "rates")
    assert head == ["h", "rate", "counts"]
    rates = of["rate"].values[np.isfinite(of["h_coarse"].values)]
    assert [row[1] for row in body] == [f"{rate:.2f}" for rate in rates]
    assert [row[2] for row in body].count("yes") == int(of["asymptotic"].sum())


def test_an_error_in_the_dual_norm_stands_between_its_bounds(opened):
    choose(opened, case="square/natural", norm="hm12", ratio="1/2")
    head, *body = rows(opened, "errors")
    assert head == ["h", "H", "error", "at least", "at most", "sharp bound", "cheap bound"]
    for _, _, error, lower, upper, *_ in body:
        assert 0 < float(lower) <= float(error) <= float(upper)


def test_every_choice_is_drawn_without_an_error(browser):
    """On a phone; also where nothing is judged, and where the error is 0, which is said and not drawn."""
    page = browser.open(RESULTS / "report/curves.html", (390, 844))
    seen = browser.driver.execute_script(EVERY)
    cases = {each.split("/")[1] for each, *_ in seen}
    assert {*stored("square/rates")["case"].values.tolist(), "violates_jjj"} <= cases
    assert len(seen) == 6 * len({each for each, *_ in seen}) > 100
    for case, norm, _, title, observed, lines in seen:
        assert title, case
        assert (lines == 0) == ("error 0, as exact" in observed), (case, norm)
    assert page.errors == [entry for entry in browser.driver.get_log("browser") if entry["level"] == "SEVERE"]
    assert browser.overflow() == 0


def test_the_lists_have_names_and_the_picture_a_description(opened):
    labels = [each.text.splitlines()[0] for each in opened.driver.find_elements("css selector", "label")]
    assert labels == ["case, by scene", "norm", "h/H"]
    for norm, name in NORMS.items():
        choose(opened, case="square/natural", norm=norm)
        told = opened.driver.find_element("id", "plot").get_attribute("aria-label")
        assert told == f"The error of {name} over h at h/H = 1/2, case natural, on logarithmic axes"
