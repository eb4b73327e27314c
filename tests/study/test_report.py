"""The report, as a reader sees it in Chromium: one file, without a network, in which everything opens."""

import json
import re
import subprocess
import sys

import pytest
from conftest import ROOT
from selenium.webdriver.common.by import By
from selenium.webdriver.support.ui import WebDriverWait

from study.documents import pages

SECONDS = 30


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    """Made as `make report` makes it, of the stored results."""
    target = tmp_path_factory.mktemp("report") / "report.html"
    command = [sys.executable, "workflow/write_report.py", str(target)]
    process = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=120)
    assert process.returncode == 0, process.stderr
    assert [file.name for file in target.parent.iterdir()] == ["report.html"]
    return target


@pytest.fixture
def report_page(browser, report):
    """The report's first page, without an error and without a request that leaves this machine."""
    page = browser.open(report)
    assert page.title == "Snakemake Report"
    assert (page.errors, page.elsewhere) == ([], [])
    return browser.driver


def wait(driver, condition):
    return WebDriverWait(driver, SECONDS).until(condition)


def press(driver, name):
    """An entry of the menu at the left."""
    entries = driver.find_elements(By.CSS_SELECTOR, "nav li a, nav li")
    next(entry for entry in entries if entry.text.strip() == name).click()


def list_rows(driver, category):
    """The rows of a category's list."""
    press(driver, category)
    return wait(driver, lambda d: d.find_elements(By.CSS_SELECTOR, "nav tbody tr"))


def open_row(driver, category, name):
    """The text of the page that a row of a category opens."""
    rows = list_rows(driver, category)
    next(row for row in rows if row.text.startswith(name)).find_element(By.TAG_NAME, "a").click()
    frame = wait(driver, lambda d: d.find_elements(By.TAG_NAME, "iframe"))[0]
    driver.switch_to.frame(frame)
    text = wait(driver, lambda d: d.find_element(By.TAG_NAME, "body").text)
    driver.switch_to.default_content()
    return text


def test_every_committed_figure_is_in_it_and_its_picture_has_a_size(report_page):
    names = [row.find_element(By.TAG_NAME, "td").text for row in list_rows(report_page, "Figures")]
    assert sorted(names) == sorted(file.stem for file in (ROOT / "figures").glob("*.svg"))
    report_page.find_element(By.CSS_SELECTOR, "nav tbody tr a").click()
    picture = wait(report_page, lambda d: d.find_elements(By.CSS_SELECTOR, "#app > div img, .grow img"))[-1]
    assert wait(report_page, lambda d: picture.get_property("naturalWidth")) > 400
    # what a list shows leaves room for the picture
    assert picture.location["x"] < 700


def test_a_figure_says_what_it_was_drawn_from(report_page):
    row = next(row for row in list_rows(report_page, "Figures") if row.text.startswith("verdict"))
    row.find_elements(By.TAG_NAME, "a")[-1].click()
    report = wait(report_page, lambda d: d.find_element(By.TAG_NAME, "nav").text)
    assert "figures/verdict.csv by workflow/scripts/draw_verdict.py" in " ".join(report.split())


def test_the_judged_claims_are_in_it(report_page):
    text = open_row(report_page, "Tables", "Every claim")
    for claim in json.loads((ROOT / "results/claims.json").read_text()):
        assert re.search(rf"^{re.escape(claim['id'])}\b", text, re.MULTILINE), claim["id"]


def test_the_rates_are_in_it(report_page):
    text = open_row(report_page, "Tables", "Rates")
    rows = re.findall(r"^\| (\w+) +\| `(.*?)` +\| (.*?) \(", blocks()["rates"], re.MULTILINE)
    assert len(rows) > 20
    for scene, case, rate in rows:
        assert f"{scene} {case} {rate}" in text


def blocks():
    return json.loads((ROOT / "results/blocks.json").read_text())


def test_a_case_can_be_chosen_in_it(report_page):
    """The page's script runs within the report, too, though it is larger than Chromium's data URLs may be.

    Without the script that makes blobs of such results the frame stays empty.
    """
    assert (ROOT / "results/report/curves.html").stat().st_size * 4 / 3 > 2**21
    text = open_row(report_page, "Tables", "Errors and rates")
    assert "Observed rate of the expected one: " in text


def test_versions_and_parameters_are_in_it(report_page):
    text = open_row(report_page, "Tables", "Versions")
    document = json.loads((ROOT / "results/manifest.json").read_text())
    assert document["parameters"] in text
    assert all(f"{name} {version}" in text for name, version in document["versions"].items())
    assert "judged_ratio: 1/2" in text


def test_the_first_page_shows_results_and_the_graph_of_rules_below_them(report_page):
    """As the report opens: its text begins within the window, and the graph where the text has ended."""
    text = wait(report_page, lambda d: d.find_element(By.CSS_SELECTOR, "#app .document"))
    graph = wait(report_page, lambda d: d.find_element(By.CSS_SELECTOR, "#app canvas, #app svg.marks"))
    beta = json.loads((ROOT / "results/numbers.json").read_text())["claims.S.local.observed"]
    assert f"the least inf-sup constant that was found is {str(beta)[:4]}" in text.text
    assert text.location["y"] >= 0
    assert graph.location["y"] >= text.location["y"] + text.size["height"]


def test_the_supplement_opens(report_page):
    title = re.search(r"^title: (.*)$", (ROOT / "supplement.md").read_text(), re.MULTILINE)[1]
    text = open_row(report_page, "Paper", "supplement, as a page")
    assert title.strip('"') in " ".join(text.split())
    assert "References" in text


def test_a_report_of_results_that_are_not_there_is_refused(tmp_path):
    """Of one rule. This takes as long as Snakemake takes to begin."""
    (tmp_path / "Snakefile").write_text(
        "rule made:\n    output: report('x.svg')\n    shell: 'touch {output}'\n"
    )
    command = [sys.executable, ROOT / "workflow/write_report.py", "report.html"]
    process = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=120)
    assert process.returncode == 1
    assert re.search(r"File \S+ marked for report but does not exist", process.stderr)
    assert "Traceback" not in process.stderr
    assert not (tmp_path / "report.html").exists()


def test_what_a_page_of_provenance_tells(tmp_path):
    """Numbers of files and their sizes by rule, summed by hand."""
    parameters = tmp_path / "study.yaml"
    parameters.write_text("h: 1/8\n")
    sizes = {"solve": (1_500_000, 500_000), "rates": (2_000,)}
    files = [{"rule": rule, "bytes": size} for rule, all_of in sizes.items() for size in all_of]
    manifest = {"versions": {"numpy": "2.0"}, "parameters": "abc", "files": files}
    provenance_blocks = pages.provenance_blocks(manifest, [str(parameters)])
    rows = [
        [cell.strip() for cell in row.split("|")[1:-1]] for row in provenance_blocks["files"].splitlines()
    ]
    assert rows[2:] == [["solve", "2", "2"], ["rates", "1", "0.002"]]
    assert "| numpy" in provenance_blocks["versions"]
    assert provenance_blocks["parameters"].endswith(f"## `{parameters}`\n\n```yaml\nh: 1/8\n```")
    assert provenance_blocks["parameters"].startswith("SHA-256 of the configuration: `abc`")


@pytest.mark.parametrize("width", [600, 1000, 1400])
@pytest.mark.parametrize("page", ["paper/paper", "report/claims", "report/rates", "report/provenance"])
def test_no_page_is_wider_than_its_window(browser, page, width):
    """Wide tables scroll by themselves; without that, a formula in a table reached 49 pixels beyond 1000."""
    view = browser.open(ROOT / f"results/{page}.html", (width, 900))
    assert (view.errors, view.elsewhere) == ([], [])
    assert browser.overflow() == 0
