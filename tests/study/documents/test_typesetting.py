"""Papers as HTML and PDF: a page with every feature that they use, and faults to be refused."""

import re

import pytest
import sentences
import typst
from conftest import ROOT

from study.documents import typesetting
from unilateral.errors import InputError

BIBLIOGRAPHY = "@book{Known, author = {Jane Doe}, title = {A Book}, year = {1980}}\n"
PICTURE = '<svg xmlns="http://www.w3.org/2000/svg" width="9" height="9"><circle cx="4" cy="4" r="3"/></svg>\n'
FRONT = """---
title: The *title*
tags: [one tag, another]
authors:
  - name: The developers
    affiliation: 1
affiliations:
  - name: Nowhere
    index: 1
date: 21 November 2026
bibliography: paper.bib
---

"""
PAGE = r"""# Summary {#sec-summary}

Unicode such as λ, β, ‖·‖, ∂Ω, H⁻½, ≤, ∇ and mathematics such as $\|\lambda-\lambda_H\|_{-1/2}$; see
[Section 1.1](#sec-in), [Figure 1](#fig-one), [Table 1](#tbl-wide), [Theorem A](#thm-a), [(2.7)](#eq-one) and
[@Known, p. 3]. There are [Supplement, Table S1](other.md#tbl-there) and
[Supplement, Lemma 3](other.md#lem-there).

## Inside {#sec-in}

$$\begin{aligned} (u_h, v)_1 &= (f, v)_0 && \text{for all } v \in V_h \end{aligned} \tag{2.7}\label{eq-one}$$

::: {.theorem #thm-a}
**Theorem A.** It is $O(H^{3/2})$.
:::

::: {.proof}
*Proof.* Obvious.
:::

![What it shows.](one.svg){#fig-one}

It is 0.19
here: $x=0.19$.

<!-- wide: begin -->
| a | b | c | d | e | f | g | h |
|---|---|---|---|---|---|---|---|
| 1 | 2 | 3 | 4 | 5 | 6 | LONG | `a/path/to/some_file.svg` |
<!-- wide: end -->

: What it lists. {#tbl-wide}
""".replace("LONG", "a sentence that is much longer than a column " * 3)

OTHER = """---
prefix: S
---

# Elsewhere {#sec-there}

::: {.theorem #lem-there}
**Lemma 3** (of another)**.** So it is.
:::

<!-- rows: begin -->
| a |
|---|
| <!--=a.b:.2f-->1<!--/--> |
<!-- rows: end -->

: Rows. {#tbl-there}
"""


def typesetter(folder):
    """Typesets a page in that folder; returns its HTML and its PDF."""
    (folder / "paper.bib").write_text(BIBLIOGRAPHY)
    (folder / "one.svg").write_text(PICTURE)
    (folder / "other.md").write_text(OTHER)
    templates = [ROOT / "workflow/paper" / name for name in ("numbers.lua", "paper.html", "paper.typ")]
    html = folder / "paper.html"
    pdf = folder / "paper.pdf"

    def run(text):
        (folder / "paper.md").write_text(text, encoding="utf-8")
        typesetting.typeset_paper(folder / "paper.md", *templates, html, pdf)
        return html.read_text(encoding="utf-8"), pdf.read_bytes()

    return run


@pytest.fixture
def typeset(tmp_path):
    return typesetter(tmp_path)


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    """The HTML and the PDF of the page with every feature."""
    return typesetter(tmp_path_factory.mktemp("page"))(FRONT + PAGE)


def read_html_text(html):
    """The text that a reader of the HTML sees, formulas without their TeX."""
    body = html.split("<body>")[1]
    return " ".join(re.sub(r"<annotation.*?</annotation>|<[^>]*>", "", body, flags=re.DOTALL).split())


def test_a_page_with_every_feature_becomes_html_and_pdf(page):
    html, pdf = page
    assert pdf.startswith(b"%PDF")
    text = read_html_text(html).replace("\u00a0", " ")
    for expected in ("The title", "The developers1", "1Nowhere", "21 November 2026", "one tag, another"):
        assert expected in text
    assert "see Section 1.1, Figure 1, Table 1, Theorem A, (2.7) and (Doe 1980, 3)" in text
    for numbered in ("1 Summary", "1.1 Inside", "Figure 1. What it shows.", "Table 1. What it lists."):
        assert numbered in text
    assert '<span class="number">(2.7)</span>' in html, "pandoc drops \\tag"
    assert '<div class="proof">' in html
    assert html.count("<math") == 4
    assert 'form="prefix">‖' in html, "the bars of a norm open and close"
    assert "one.svg" not in html, "figures are part of the page"
    contents = html.split("<nav")[1].split("</nav>")[0]
    anchors = re.findall(r'href="#([^"]+)"', contents)
    assert anchors == ["sec-summary", "sec-in", "bibliography"], "a section, one in it, the references"
    assert all(f'id="{anchor}"' in html for anchor in anchors)


def test_a_proof_ends_with_a_box_after_its_last_words_or_below_its_last_list(tmp_path):
    """In typst's source: a box is no item of the list."""
    (tmp_path / "paper.bib").write_text(BIBLIOGRAPHY)

    def print_proof(proof):
        text = f"{FRONT}# One {{#sec-one}}\n\n::: {{.proof}}\n{proof}\n:::\n\nMore.\n"
        templates = (ROOT / "workflow/paper" / name for name in ("numbers.lua", "paper.typ"))
        return typesetting._convert_markdown(text, tmp_path / "paper.md", "typst", *templates)

    assert "Obvious.#qed\n\n]" in print_proof("*Proof.* Obvious.")
    assert re.search(r"^\+ Two\.\n+#qed\n+\]", print_proof("1. One.\n2. Two."), re.MULTILINE)


def test_numbers_have_the_prefix_of_their_paper_and_its_sections_letters(typeset):
    page = PAGE
    for name, with_prefix in (
        ("Section 1.1", "Section A.1"),
        ("Figure 1", "Figure S1"),
        ("Table 1", "Table S1"),
    ):
        page = page.replace(f"[{name}]", f"[{with_prefix}]")
    text = read_html_text(typeset(FRONT.replace("title:", "prefix: S\ntitle:") + page)[0])
    for numbered in ("A Summary", "A.1 Inside", "Figure S1. What", "Table S1. What", "Theorem A", "(2.7)"):
        assert numbered in text


def test_links_into_another_paper_lead_to_its_page_and_are_text_in_print(page):
    """A PDF file would lead nowhere once it is moved; its links have a URI, those within it none."""
    html, pdf = page
    assert '<a href="other.html#tbl-there">Supplement, Table\u00a0S1</a>' in html
    assert '<a href="other.html#lem-there">Supplement, Lemma\u00a03</a>' in html
    assert b"/URI" not in pdf


def test_the_same_page_gives_the_same_bytes(typeset, page):
    """In another folder, too. Control: another page."""
    assert typeset(FRONT + PAGE) == page
    assert typeset(FRONT + PAGE.replace("It is", "It was"))[1] != page[1]


def test_marks_are_not_seen_in_text_formulas_tables_and_captions(typeset, page):
    """The same bytes as without them."""
    marked = PAGE
    for text, with_marks in (
        ("| 1 |", "| <!--=a-->1<!--/--> |"),
        ("What it lists", "What <!--?A.1-->it lists<!--/-->"),
        ("It is 0.19\nhere:", "It <!--?A.1-->is <!--=a:.2f-->0.19<!--/-->\nhere:<!--/-->"),
        ("$x=0.19$", "$x=<!--=a:.2f-->0.19<!--/-->$"),
    ):
        assert marked.count(text) == 1
        marked = marked.replace(text, with_marks)
    assert typeset(FRONT + marked) == page


def test_a_wide_table_gives_each_column_its_longest_word_and_long_cells_the_rest(typeset, page):
    widths = [int(width) for width in re.findall(r'<col style="width: (\d+)%"', page[0])]
    assert len(widths) == 8
    assert sum(widths) <= 100
    assert min(widths[6:]) > 2 * max(widths[:6])
    assert len(set(widths[:6])) == 1
    assert "<col " not in typeset(FRONT + PAGE.replace("that is much longer than a column", ""))[0]


def test_a_head_that_does_not_fit_its_column_is_refused(typeset):
    """Heads are not hyphenated. Three words of 48 letters do not fit into a line."""
    long = ("multiplicity " * 3).split()
    narrow = "| a " * 5
    heads = f"{narrow}| {' | '.join(long)} |"
    cells = "| a longer sentence in a cell " * 7 + f"| {'a ' * 30}|"
    wide = f"{heads}\n{'|---' * 8}|\n{cells}\n\n: What it lists. {{#tbl-wide}}\n"
    page = FRONT + PAGE[: PAGE.index("<!-- wide")] + wide
    assert len(typeset(page)) == 2
    with sentences.raises(InputError):
        typeset(page.replace("multiplicity", "multiplicity" * 4))


def test_scripts_in_plain_text_are_raised_and_lowered_and_code_and_links_are_not(typeset):
    text = "\n\n2·10^9 u_h, λ^n, H^(−1/2), ‖μ‖_{-1/2,h}, `a_b^2`, [a_b](https://example.org/a_b).\n"
    html, _ = typeset(FRONT + PAGE + text)
    expected = ("10<sup>9</sup> u<sub>h</sub>", "λ<sup>n</sup>", "H<sup>−1/2</sup>", "‖μ‖<sub>-1/2,h</sub>")
    for shown_as in (*expected, "<code>a_b^2</code>", ">a_b</a>"):
        assert shown_as in html


@pytest.mark.parametrize(
    ("right", "wrong"),
    [
        ("@Known", "@Unknown"),
        ("(#fig-one)", "(#fig-two)"),
        ("[Figure 1]", "[Figure 2]"),
        ("[Section 1.1]", "[]"),
        ("(#thm-a)", "(#thm-b)"),
        ("[Theorem A](#thm-a)", "[it](#thm-b)"),
        ("[Theorem A]", "[Theorem B]"),
        ("[(2.7)]", "[(2.8)]"),
        ("Table S1]", "Table S2]"),
        ("(other.md#tbl-there)", "(other.md#tbl-gone)"),
        ("(other.md#tbl-there)", "(gone.md#tbl-there)"),
        ("(one.svg)", "(two.svg)"),
        (r"\begin{aligned} (", r"\begin{aligned} \rule{1cm}{1cm} ("),
        ("(u_h, v)_1", "+".join(["(u_h, v)_1"] * 12)),
        ("such as λ", "such as \u1369"),
        ("21 November 2026", "one day"),
    ],
)
def test_what_cannot_be_typeset_is_refused_and_nothing_is_written(typeset, tmp_path, right, wrong):
    assert right in FRONT + PAGE
    with sentences.raises(InputError) as refused:
        typeset((FRONT + PAGE).replace(right, wrong))
    assert "\n" not in str(refused.value)
    assert not list(tmp_path.glob("*.pdf")) + list(tmp_path.glob("*.html"))


def test_the_first_page_of_the_report_is_restructured_text_without_marks():
    text = "# Head\n\n- **Bold.** It is <!--?A.1-->at least <!--=a:.2f-->0.64<!--/-->.<!--/-->\n"
    converted = typesetting.convert_to_restructured_text(text)
    assert converted == "Head\n====\n\n- **Bold.** It is at least 0.64.\n"


def test_print_uses_only_fonts_that_typst_carries():
    template = (ROOT / "workflow/paper/paper.typ").read_text(encoding="utf-8")
    used = set(re.findall(r'"([A-Z][a-z]+(?: [A-Z][a-z]+)+)"', template))
    assert used
    assert used <= set(typst.Fonts(include_system_fonts=False).families())


def test_every_reference_of_the_bibliography_can_be_cited(typeset, tmp_path):
    bibliography = (ROOT / "paper.bib").read_text(encoding="utf-8")
    keys = re.findall(r"^@\w+\{(\w+),$", bibliography, re.MULTILINE)
    assert len(keys) == len(set(keys)) == bibliography.count("@")
    (tmp_path / "paper.bib").write_text(bibliography, encoding="utf-8")
    html, _ = typeset(FRONT + "[" + "; ".join(f"@{key}" for key in keys) + "]\n")
    assert html.count('class="csl-entry"') == len(keys)
