"""The paper stays short, its pages in print and its words, and so does the supplement."""

import re

import pytest
from conftest import ROOT

from study.documents import marks

PAGES = 12
WORDS = 6500  # a page and a half of it are references
"""The most pages and words of paper.md: somebody reads so much in one sitting."""
SUPPLEMENT_WORDS = 17_000
"""The most of supplement.md; blanks divide its formulas into words, too."""


def words(text):
    """Of the body and its captions: a formula in a line is one word, others and tables are none."""
    body = marks.remove_marks(text).partition("\n---\n")[2]
    body = re.sub(r"\$\$(?s:.*?)\$\$|^\|.*$|^:::.*$|\{#[\w-]+\}|\]\([^)\s]*\)", "", body, flags=re.MULTILINE)
    return len(re.sub(r"\$[^$]+\$", "x", body).split())


def pages(pdf):
    (count,) = re.findall(rb"/Type ?/Pages\b[^>]*?/Count (\d+)", pdf)
    return int(count)


def test_the_paper_keeps_to_its_pages():
    assert pages((ROOT / "results/paper/paper.pdf").read_bytes()) <= PAGES


def test_the_paper_keeps_to_its_words():
    assert words((ROOT / "paper.md").read_text(encoding="utf-8")) <= WORDS


def test_the_supplement_keeps_to_its_words():
    assert len((ROOT / "supplement.md").read_text(encoding="utf-8").split()) <= SUPPLEMENT_WORDS


@pytest.mark.parametrize(
    ("body", "count"),
    [
        ("Two words.", 2),
        ("As $a + b = c$ says,\n$$\nx = 1 \\tag{1}\n$$\nit <!--=a:.2f-->is 1<!--/-->.", 6),
        ("| a | b |\n|---|---|\n| c | d |\n\n: Caption. {#tbl-a}", 2),
        ("::: {.theorem #thm-a}\n**Theorem.** See [Figure 1](#fig-a).\n:::", 4),
    ],
)
def test_words_are_counted_as_by_hand(body, count):
    """By hand; the colon of a caption is a word."""
    assert words(f"---\ntitle: A long title\n---\n\n{body}\n") == count
