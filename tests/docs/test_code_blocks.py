"""Every code block of the documents works as it stands, from top to bottom of each page.

Commands are run, programs executed, problem files looked at, and what is said to be printed is compared. A
block that no test can run says so in the line before it: `<!-- not run: REASON -->`.
"""

import glob
import re
import shlex
import subprocess
import sys

import meshio
import numpy as np
import pytest
import yaml
from conftest import ROOT
from documents import PAGES, Block, blocks, blocks_in

import unilateral as ul
from unilateral.cli import main
from unilateral.geometry.polygon import named
from unilateral.geometry.structured import structured

pytestmark = pytest.mark.usefixtures("shared_cases")
FOLDERS = ("examples", "results")
"""What pages name of the project."""


def own_mesh():
    """A reader's mesh of the unit square, in three coordinates as gmsh writes them."""
    mesh = structured(named("square"), 1 / 8)
    points = np.column_stack([mesh.points, np.zeros(mesh.n_nodes)])
    meshio.Mesh(points, [("triangle", mesh.triangles)]).write("own.msh", file_format="gmsh")


def own_solutions():
    """A reader's solutions of `natural` on the levels of docs/own-solver.md; here they are this project's."""
    for level in range(5):
        h = 1 / 2 ** (level + 2)
        ul.solve(ul.case("natural"), h=h, H=2 * h).save(f"level_{level}.vtu")


READERS_FILES = {
    "own.msh": own_mesh,
    "level_": own_solutions,
    "solve problem.yaml": lambda: main(["init", "problem.yaml"]),
}
"""What a reader has: what a page says of it, and what makes it."""


@pytest.fixture
def told(tmp_path, monkeypatch, capsys):
    """Runs blocks one after the other in a reader's folder; those of the kind `text` show what is printed."""
    monkeypatch.chdir(tmp_path)
    for name in FOLDERS:
        (tmp_path / name).symlink_to(ROOT / name)

    def run(page_blocks):
        everything = "".join(block.text for block in page_blocks)
        for wanted, make in READERS_FILES.items():
            if wanted in everything:
                make()
        printed, done, names = "", [], {"__name__": "__main__"}
        for block in page_blocks:
            if block.reason is None:
                capsys.readouterr()
                RUN[block.kind](block, printed, names)
                printed = printed if block.kind == "text" else "".join(capsys.readouterr())
                done.append(block)
        return done

    return run


def commands(block, *_):
    for line in block.text.splitlines():
        if words := shlex.split(line, comments=True):
            program, *arguments = [name for word in words for name in sorted(glob.glob(word)) or [word]]
            assert RUNNERS[program](arguments) == 0, f"{place(block)}: {line}"


def python_file(arguments):
    return subprocess.run([sys.executable, *arguments], timeout=120).returncode


def program(block, _, names):
    """The programs of a page follow one another and know the same names."""
    exec(compile(block.text, place(block), "exec"), names)


def declaration(block, *_):
    """A case or a problem; its first line may name its file."""
    name = re.match(r"# ([\w.]+\.yaml)\n", block.text)
    file = name[1] if name else "declared.yaml"
    with open(file, "w", encoding="utf-8") as written:
        written.write(block.text)
    if "u" in yaml.safe_load(block.text):
        ul.case(file)
    else:
        assert main(["check", file]) == 0, place(block)


def output(block, printed, _):
    parts = [re.escape(part.strip()) for part in block.text.split("...")]
    assert re.search(".*".join(parts), printed, re.DOTALL), f"{place(block)}: printed was\n{printed}"


def place(block):
    return f"{block.page}, line {block.line}"


RUNNERS = {"unilateral": main, "python": python_file}
RUN = {"": commands, "python": program, "yaml": declaration, "text": output}


@pytest.mark.parametrize("page", [page for page in PAGES if blocks(page)])
def test_the_blocks_of_a_page_run(page, told):
    """A page takes as long as all that it types, up to some ten seconds."""
    assert told(blocks(page)) == [block for block in blocks(page) if block.reason is None]


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
def test_a_block_that_does_not_work_is_noticed(page, told):
    """Control; with a mark it is not run."""
    with pytest.raises((AssertionError, AttributeError, KeyError)):
        told(blocks_in(page))
    assert told(blocks_in("<!-- not run: it is spoilt -->\n".join(["", *page.split("\n\n")]))) == []


def test_a_block_in_a_list_is_run_without_its_indentation(told):
    page = "- Say it:\n\n  ```python\n  for c in 'ab':\n      print(c)\n  ```\n\n  ```text\n  a\n  b\n  ```\n"
    assert [block.kind for block in told(blocks_in(page))] == ["python", "text"]


def test_what_is_printed_is_compared_but_for_dots(told):
    page = "```python\nprint('one')\nprint(2)\nprint('three')\n```\n\n```text\n{}\n```\n"
    assert len(told(blocks_in(page.format("one\n...\nthree")))) == 2
    assert isinstance(blocks_in(page)[0], Block)
    with pytest.raises(AssertionError, match="line 7: printed was"):
        told(blocks_in(page.format("one\nthree")))
