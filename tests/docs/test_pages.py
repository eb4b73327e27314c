"""The pages that `make docs` builds: without a warning, whole, complete, and right in a browser."""

import inspect
import json
import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest
from conftest import ROOT

import unilateral as ul

NARROW = (400, 900)
PAPERS = ("paper.html", "supplement.html")
WITH_FRACTIONS = ("docs/index.html", "docs/method.html", "docs/tutorial.html")
FETCHED = {"src", "srcset", "poster", "data", "background"}
IN_STYLES = re.compile(r"""@import\s+["']?([^"';)]+)|url\(\s*["']?([^"')]+)""")


BUILD = "import sys, json; from sphinx.cmd.build import main; print(*map(main, json.loads(sys.argv[1])))"


def built(*builds):
    """What `make docs` runs, from sources into folders, one after the other: exit codes, and what is told.

    A build is the folder of the configuration, that of the sources, and the one to write to. One process
    builds all of them, for Sphinx takes seconds to begin.
    """
    words = [
        ["-qWE", "-w", f"{target}.told", "-c", *map(str, (docs, sources, target))]
        for docs, sources, target in builds
    ]
    command = [sys.executable, "-c", BUILD, json.dumps(words)]
    run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=300)
    texts = [Path(f"{target}.told").read_text(encoding="utf-8") for _, _, target in builds]
    return list(zip(map(int, run.stdout.split()), texts, strict=True))


@pytest.fixture(scope="session")
def site(tmp_path_factory):
    """All pages, built once for all tests; Sphinx takes seconds, and notebooks some 20."""
    folder = tmp_path_factory.mktemp("docs") / "site"
    assert built(("docs", ROOT, folder)) == [(0, "")]
    return folder


class Page(HTMLParser):
    """Its anchors, what it links to, and what is fetched with it."""

    def __init__(self, text):
        super().__init__()
        self.anchors = set()
        self.links = []
        self.fetched = []
        self.style = False
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        attributes_by_name = {name: value or "" for name, value in attributes}
        self.style = tag == "style"
        self.anchors |= {attributes_by_name[name] for name in ("id", "name") if name in attributes_by_name}
        self.fetched += [
            attributes_by_name[name].split()[0]
            for name in FETCHED & {*attributes_by_name}
            if attributes_by_name[name]
        ]
        self.fetched += find_in_styles(attributes_by_name.get("style", ""))
        if "href" in attributes_by_name:
            into = (
                self.links
                if tag in ("a", "area") or attributes_by_name.get("rel") in ("next", "prev")
                else self.fetched
            )
            into.append(attributes_by_name["href"])

    def handle_data(self, data):
        if self.style:
            self.fetched += find_in_styles(data)


def find_in_styles(text):
    return [first or second for first, second in IN_STYLES.findall(text)]


def faults(site):
    """What pages and styles fetch from elsewhere, and links within the folder that lead nowhere.

    The paper and its supplement are pages that others make; links into them are looked at.
    """
    pages = {file: Page(file.read_text(encoding="utf-8")) for file in site.rglob("*.html")}
    styles = {file: find_in_styles(file.read_text(encoding="utf-8")) for file in site.rglob("*.css")}
    original = {file: page for file, page in pages.items() if file.name not in PAPERS}
    fetched = [(file, url) for file, page in original.items() for url in page.fetched]
    fetched += [(file, url) for file, urls in styles.items() for url in urls]
    links = [(file, url) for file, page in original.items() for url in page.links if not is_elsewhere(url)]
    inside = [(file, url) for file, url in fetched if not (is_elsewhere(url) or url.startswith("data:"))]
    return [f"{file.name} fetches {url}" for file, url in fetched if is_elsewhere(url)] + [
        f"{file.name} leads to {url}" for file, url in links + inside if not leads(pages, file, url)
    ]


def is_elsewhere(url):
    return urlsplit(url).scheme in ("http", "https", "mailto") or bool(urlsplit(url).netloc)


def leads(pages, file, url):
    """Whether there is such a file, with such an anchor."""
    address = urlsplit(url)
    target = (file.parent / unquote(address.path)).resolve() if address.path else file
    page = pages.get(target)
    return target.is_file() and (not address.fragment or (page and unquote(address.fragment) in page.anchors))


def test_links_lead_somewhere_and_nothing_is_fetched_from_elsewhere(site):
    assert len([*site.rglob("*.html")]) > 15
    assert faults(site) == []


NOTEBOOK = """---
file_format: mystnb
kernelspec: { name: python3 }
---
# Own

```{code-cell}
print(6 * 7)
```
"""


def write_own_pages(folder):
    """Pages with the configuration of the project's, in a folder without the study.

    One has links of the repository, two are notebooks. Of the tables that the one about the study opens,
    those of the scene `quick` are there, as after `make quick`.
    """
    (folder / "docs/notebooks").mkdir(parents=True)
    for name in ("conf.py", "rendering.py", "site", "static"):
        (folder / "docs" / name).symlink_to(ROOT / "docs" / name)
    for name in ("quick/errors.nc", "quick/rates.nc", "square/rates.nc"):
        (folder / "results" / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / "results" / name).touch()
    for name in ("README", "paper", "supplement"):
        (folder / f"{name}.md").write_text("# Other\n")
    links = "[a folder](../docs), [another text](../README.md), [this page](index.md#home), "
    links += "[the paper](../paper.md), [a part](../supplement.md#sec-total)"
    contents = "```{toctree}\npaper\nnotebook\nnotebooks/study-tables\n```\n"
    (folder / "docs/index.md").write_text(f"# Home\n\n{links}\n\n{contents}")
    (folder / "docs/paper.md").write_text("# How to make it\n")
    (folder / "docs/notebook.md").write_text(NOTEBOOK)
    text = (ROOT / "docs/notebooks/study-tables.md").read_text(encoding="utf-8")
    (folder / "docs/notebooks/study-tables.md").write_text(re.sub(r"\]\(\.\.[^)]+\)", "]", text))


def write_failing_notebook(folder):
    (folder / "docs").mkdir(parents=True)
    (folder / "docs/index.md").write_text(NOTEBOOK.replace("6 * 7", "1 / 0"))


@pytest.fixture(scope="module")
def small_sites(tmp_path_factory):
    """The pages of three small sites: their folder, the exit code of their build, and what it tells."""
    folder = tmp_path_factory.mktemp("sites")
    write_own_pages(folder / "own")
    write_spoilt_pages(folder / "spoilt")
    write_failing_notebook(folder / "failing")
    configured = {"own": folder / "own/docs", "spoilt": "docs", "failing": "docs"}
    builds = [(docs, folder / name, folder / name / "pages") for name, docs in configured.items()]
    return {
        name: (folder / name / "pages/docs", *report)
        for name, report in zip(configured, built(*builds), strict=True)
    }


@pytest.fixture
def own_pages(small_sites):
    """The folder of the small site without a fault, which is built without a warning."""
    folder, code, messages = small_sites["own"]
    assert (code, messages) == (0, "")
    return folder


def test_links_of_the_repository_to_what_is_no_page_are_text(own_pages):
    """A folder, and Markdown that is no page; what is not there at all is refused, see below."""
    text = (own_pages / "index.html").read_text(encoding="utf-8")
    assert "<p>a folder, another text, <a " in text


def test_without_the_typeset_paper_links_lead_to_the_page_that_says_how_to_make_it(own_pages):
    """Pages in other folders have no such links."""
    links = Page((own_pages / "index.html").read_text(encoding="utf-8")).links
    assert links.count("paper.html") >= 3  # the two, and the one of the contents
    assert not any("sec-total" in link for link in links)
    to_a_paper = re.compile(r"\]\([./]*(paper|supplement)\.md(#[\w-]+)?\)")
    assert to_a_paper.search((ROOT / "docs/accuracy.md").read_text(encoding="utf-8"))
    elsewhere = [ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md"]
    for folder in ("docs/notebooks", "manufactured", "benchmarks"):
        elsewhere += (ROOT / folder).glob("*.md")
    assert not [file for file in elsewhere if to_a_paper.search(file.read_text(encoding="utf-8"))]


def test_a_notebook_shows_what_it_prints(own_pages):
    """Control of the notebook that fails, below."""
    assert ">42\n" in (own_pages / "notebook.html").read_text(encoding="utf-8")


UNREAD = "This page was built without the study"


def test_without_results_the_notebook_about_them_says_what_to_run(own_pages):
    page = (own_pages / "notebooks/study-tables.html").read_text(encoding="utf-8")
    assert UNREAD in page
    assert "cell_output" not in page


SPOILT = {
    '<link rel="stylesheet" href="https://example.invalid/a.css">': "fetches https://example.invalid/a.css",
    '<script src="//example.invalid/a.js"></script>': "fetches //example.invalid/a.js",
    '<img srcset="http://example.invalid/a.png 2x">': "fetches http://example.invalid/a.png",
    "<style>@import 'https://example.invalid/b.css';</style>": "fetches https://example.invalid/b.css",
    "<p style='background: url(https://example.invalid/c.png)'>": "fetches https://example.invalid/c.png",
    '<img src="none.png">': "leads to none.png",
    '<a href="none.html">none</a>': "leads to none.html",
    '<a href="#none">none</a>': "leads to #none",
    '<a href="other.html#none">none</a>': "leads to other.html#none",
    '<a href="other.html#there">a</a><a href="https://example.invalid">b</a><img src="data:,">': None,
}


@pytest.mark.parametrize(("spoilt", "fault"), SPOILT.items())
def test_a_page_that_fetches_or_leads_nowhere_is_found(tmp_path, spoilt, fault):
    """Control; the last one has no fault."""
    (tmp_path / "page.html").write_text(f"<!doctype html><p>{spoilt}")
    (tmp_path / "other.html").write_text("<!doctype html><p id=there>")
    assert faults(tmp_path) == ([f"page.html {fault}"] if fault else [])


def test_a_font_from_elsewhere_is_found_in_a_style(tmp_path):
    """Control."""
    (tmp_path / "a.css").write_text('@font-face { src: url("https://example.invalid/font.woff2") }')
    assert faults(tmp_path) == ["a.css fetches https://example.invalid/font.woff2"]


DIRECTIVE = "```{{eval-rst}}\n.. {}\n```"
BROKEN = [
    ("[nowhere](nowhere.md)", r"spoilt_0\b.* WARNING: .*nowhere"),
    ("[part](#nowhere)", r"spoilt_1\b.* WARNING: .*nowhere"),
    (
        DIRECTIVE.format("autofunction:: unilateral.nothing"),
        r"WARNING: .* 'nothing' from module 'unilateral'",
    ),
    (
        DIRECTIVE.format(
            "autoclass:: unilateral.adaptive.level.Level\n   :members: goal\n   :undoc-members:"
        ),
        r"WARNING: .*\.Goal\b",
    ),
]


def write_spoilt_pages(folder):
    """Pages with a fault each: the build goes on to the end."""
    (folder / "docs").mkdir(parents=True)
    (folder / "docs/index.md").write_text("# Home\n")
    for k, (text, _) in enumerate(BROKEN):
        (folder / f"docs/spoilt_{k}.md").write_text(f"---\norphan: true\n---\n# Spoilt\n\n{text}\n")


@pytest.mark.parametrize("messages", [messages for _, messages in BROKEN])
def test_a_page_with_a_fault_is_not_built(small_sites, messages):
    """Control: a link, an anchor, a name that is not there, and a type without a description.

    With -W any one of these warnings refuses the pages.
    """
    _, code, warnings = small_sites["spoilt"]
    assert code != 0
    assert re.search(messages, warnings)


NOTEBOOKS = sorted(file.stem for file in (ROOT / "docs/notebooks").glob("*.md"))


@pytest.mark.parametrize("name", NOTEBOOKS)
def test_a_notebook_was_run(site, name):
    """It shows what it prints, and a figure."""
    page = (site / f"docs/notebooks/{name}.html").read_text(encoding="utf-8")
    assert "cell_output" in page
    assert "/_images/" in page
    assert UNREAD not in page


def test_a_notebook_that_fails_refuses_the_pages(small_sites):
    """The first one that fails ends the build."""
    assert small_sites["failing"][1] != 0


def list_documented_names():
    """The names that users are told of: the public ones, and a solution's attributes."""
    Solution = ul.Solution
    members = [name for name, member in vars(Solution).items() if name[0] != "_" and inspect.getdoc(member)]
    page = (ROOT / "docs/python.md").read_text(encoding="utf-8")
    table = page.partition("It has these attributes")[2].partition("\n\n`s.save`")[0]
    matches = re.findall(r"`(\w+)[^`]*`", "".join(re.findall(r"^\| (`.*?) \|", table, re.MULTILINE)))
    assert len(matches) > 12
    return {f"unilateral.{name}" for name in ul.__all__} | {
        f"unilateral.Solution.{name}" for name in [*members, *matches]
    }


def test_all_documented_names_are_on_the_page_of_the_library(site):
    page = Page((site / "docs/api.html").read_text(encoding="utf-8"))
    assert list_documented_names() - page.anchors == set()


def test_all_variables_of_tables_are_on_their_page(site):
    text = (site / "docs/tables.html").read_text(encoding="utf-8")
    names = re.findall(r"^(\w+): \[", (ROOT / "src/study/variables.yaml").read_text(), re.MULTILINE)
    assert len(names) > 100
    assert [name for name in names if f">{name}</span>" not in text] == []


def test_pages_are_quiet_in_a_browser(browser, site):
    """No error on the console, no request to another machine, nothing wider than a narrow window."""
    for file in sorted(site.rglob("*.html")):
        page = browser.open(file, NARROW)
        assert (page.errors, page.elsewhere, browser.overflow()) == ([], [], 0), file.name


@pytest.mark.parametrize(("word", "expected"), [("multiplier", "The method"), ("xylophone", "did not match")])
def test_the_search_finds_words(browser, site, word, expected):
    """Without a server, too; control: a word that is nowhere."""
    page = browser.open(site / "search.html", query=f"?q={word}")
    assert (page.errors, page.elsewhere) == ([], [])
    assert browser.shows("#search-results", expected)


def laid_out(browser):
    """Whether every formula has a height, and a fraction more than a letter."""
    formulas, fractions, letters = map(browser.heights, (".math math", ".math mfrac", ".math mi"))
    return bool(formulas) and min(formulas) > 0 and min(fractions, default=0) > 1.5 * min(letters)


@pytest.mark.parametrize("name", WITH_FRACTIONS)
def test_formulas_are_laid_out(browser, site, name):
    browser.open(site / name)
    assert laid_out(browser)


FRACTION = "<div class=math><math><mfrac><mi>a</mi><mi>b</mi></mfrac></math></div>"


@pytest.mark.parametrize(
    ("text", "right"),
    [
        (FRACTION, True),
        ("<style>math { display: none }</style>" + FRACTION, False),
        ("<div class=math><math><mi>a</mi></math></div>", False),
        ("<div class=math>a/b</div>", False),
    ],
)
def test_formulas_that_are_not_laid_out_are_found(browser, tmp_path, text, right):
    """Control: hidden, without a fraction, and no MathML."""
    (tmp_path / "page.html").write_text(f"<!doctype html>{text}")
    browser.open(tmp_path / "page.html")
    assert laid_out(browser) == right
