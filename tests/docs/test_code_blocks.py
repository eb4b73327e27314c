"""Every code block of the documents works as it stands, and the pictures that pages show are what they draw.

A block that no test can run says so in the line before it: `<!-- not run: REASON -->`.
"""

import re

import pictures
import pytest
from conftest import ROOT
from documents import PAGES, Block, blocks, blocks_in
from pictures import alike, list_pictures, read_picture, typed_on
from reader import follow

pytestmark = pytest.mark.usefixtures("shared_cases")


@pytest.fixture
def follow_blocks(tmp_path):
    """Follows blocks in a reader's folder."""
    return lambda page: follow(page, tmp_path)


@pytest.mark.parametrize("page", [page for page in PAGES if blocks(page)])
def test_the_blocks_of_a_page_run_and_draw_its_pictures(page, follow_blocks, tmp_path):
    """A page takes as long as all that it types, up to some ten seconds."""
    assert follow_blocks(blocks(page)) == [block for block in blocks(page) if block.reason is None]
    mine = [name for name in COMMITTED if page in typed_on(name)]
    old = [name for name in mine if not alike(pictures.FOLDER / name, read_picture(tmp_path, name))]
    assert old == [], "run 'make pictures'"


COMMITTED = sorted(path.name for path in pictures.FOLDER.iterdir())


def test_every_picture_is_shown_and_one_page_draws_it():
    assert len(COMMITTED) > 5
    assert sorted({name for page in PAGES for name in list_pictures(page)}) == COMMITTED
    assert {name: len(typed_on(name)) for name in COMMITTED} == dict.fromkeys(COMMITTED, 1)


def test_pictures_of_other_solutions_are_not_alike(follow_blocks, tmp_path):
    """Control: a coarser mesh, and another load."""
    problem = "# own.yaml\npolygon: [[0, 0], [1, 0], [1, 1], [0, 1]]\nf: {}\ng: 0\n"
    solved = [("first", "3 - 4*x", "1/8"), ("coarse", "3 - 4*x", "1/4"), ("other", "3 - 4.1*x", "1/8")]
    for name, f, h in solved:
        command = f"unilateral solve own.yaml --h {h} --H 1/2 -o {name}.svg"
        follow_blocks(blocks_in(f"```yaml\n{problem.format(f)}```\n\n```\n{command}\n```\n"))
    pairs = [(tmp_path / "first.svg", tmp_path / f"{name}.svg") for name, *_ in solved]
    assert [alike(*pair) for pair in pairs] == [True, False, False]


@pytest.mark.parametrize("page", PAGES)
def test_no_block_is_overlooked(page):
    """As one that has other ticks."""
    text = (ROOT / page).read_text(encoding="utf-8")
    fences = re.findall(r"^\s*(?:```|~~~)", text, re.MULTILINE)
    directives = re.findall(r"^\s*```{", text, re.MULTILINE)
    assert len(fences) == 2 * (len(blocks(page)) + len(directives))
    assert (
        text.count("<!-- not run: ") == sum(block.reason is not None for block in blocks(page)) + QUOTED[page]
    )


QUOTED = dict.fromkeys(PAGES, 0) | {"docs/adding.md": 1}
"""Marks that a page speaks of."""


def test_targets_of_make_are_there_where_they_are_not_run():
    named = re.findall(r"^\.PHONY: (.*)$", (ROOT / "Makefile").read_text(), re.MULTILINE)[0].split()
    marked = "".join(block.text for page in PAGES for block in blocks(page) if block.reason)
    targets = re.findall(r"^make (\w+)", marked, re.MULTILINE)
    assert len(targets) > 2
    assert {*targets} <= {*named}


SPOILT = {
    "a command that fails": "```\nunilateral solve natural --h 1/8 --H 0\n```\n",
    "a program that fails": "```python\nimport unilateral as ul\n\nul.solv()\n```\n",
    "a problem that is none": "```yaml\npolygon: [[0, 0], [1, 0], [0, 1]]\nf: 1\n```\n",
    "another output": "```\nunilateral --version\n```\n\n```text\nunilateral 99\n```\n",
    "a program that is not known": "```\nrm -r results\n```\n",
    "a kind that is not known": "```perl\nprint 1\n```\n",
}


@pytest.mark.parametrize("page", SPOILT.values(), ids=SPOILT)
def test_a_block_that_does_not_work_is_noticed(page, follow_blocks):
    """Control; with a mark it is not run."""
    with pytest.raises((AssertionError, AttributeError, KeyError)):
        follow_blocks(blocks_in(page))
    assert follow_blocks(blocks_in("<!-- not run: it is spoilt -->\n".join(["", *page.split("\n\n")]))) == []


def test_a_block_in_a_list_is_run_without_its_indentation(follow_blocks):
    page = "- Say it:\n\n  ```python\n  for c in 'ab':\n      print(c)\n  ```\n\n  ```text\n  a\n  b\n  ```\n"
    assert [block.kind for block in follow_blocks(blocks_in(page))] == ["python", "text"]


def test_what_is_printed_is_compared_but_for_dots(follow_blocks):
    page = "```python\nprint('one')\nprint(2)\nprint('three')\n```\n\n```text\n{}\n```\n"
    assert len(follow_blocks(blocks_in(page.format("one\n...\nthree")))) == 2
    assert isinstance(blocks_in(page)[0], Block)
    with pytest.raises(AssertionError, match="line 7: printed was"):
        follow_blocks(blocks_in(page.format("one\nthree")))
