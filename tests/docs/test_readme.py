"""README is short, what it says is printed is printed, and its first solution needs the solver only."""

import os
import re
import subprocess
import sys

import pytest
from conftest import ROOT
from documents import PAGES, blocks
from pictures import NUMBER, PRINTED

from study.documents.marks import remove_marks

README = (ROOT / "README.md").read_text(encoding="utf-8")
FIRST = "unilateral solve examples/arch.yaml"
MOST = 900
NOT_FIRST = ("gmsh", "matplotlib", "netCDF4", "pandas", "plotly", "xarray")
"""What the solver is installed without, and a mesh of any polygon, pictures and files need."""


def words(text):
    """The words that a reader sees, in tables and code, too: what has a letter or a digit between spaces."""
    read = re.sub(r"<!--.*?-->", "", remove_marks(text), flags=re.DOTALL)
    read = re.sub(r"!\[[^\]]*\]\([^)]*\)", "", read)  # pictures
    read = re.sub(r"\]\([^)]*\)", "]", read)  # where links lead
    return [word for word in read.split() if re.search(r"\w", word)]


def test_the_readme_is_short():
    assert len(words(README)) <= MOST


def test_words_are_those_that_a_reader_sees():
    """Control: eight words."""
    text = "# A title\n\n![no](a.svg) [a link](x y.md) is <!--=a.b:.2f-->0.19<!--/-->.\n\n| a b |\n|---|\n"
    assert len(words(text)) == 8


def test_the_first_problem_is_the_one_that_is_quoted():
    (quoted,) = [block.text for block in blocks("README.md") if block.kind == "yaml"]
    assert quoted == (ROOT / "examples/arch.yaml").read_text(encoding="utf-8")


def test_the_first_command_prints_what_is_quoted(run):
    """The same words, and numbers nearly the same."""
    (quoted,) = [block.text for block in blocks("README.md") if block.kind == "text"]
    assert f"```\n{FIRST}\n```" in README
    code, printed, _ = run(*FIRST.replace("examples", str(ROOT / "examples")).split()[1:])
    assert code == 0
    for line in (line for line in quoted.splitlines() if line != "..."):
        (same,) = [
            text_line
            for text_line in printed.splitlines()
            if NUMBER.sub("#", text_line) == NUMBER.sub("#", line)
        ]
        numbers = [[float(number) for number in NUMBER.findall(text_line)] for text_line in (line, same)]
        assert numbers[0] == pytest.approx(numbers[1], rel=PRINTED)


def test_the_first_solution_imports_the_solver_only(tmp_path):
    """Control: of these packages, those for pictures are imported by the command that draws one, run next."""
    arguments = FIRST.split()[1:]
    program = (
        "import sys; from unilateral.cli import main\n"
        f"assert main({arguments}) == 0; print('FIRST', *sys.modules)\n"
        f"assert main({[*arguments, '-o', str(tmp_path / 'arch.svg')]}) == 0; print('NEXT', *sys.modules)"
    )
    run = subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True
    )
    first = {*NOT_FIRST} & {*re.search("^FIRST (.*)$", run.stdout, re.MULTILINE)[1].split()}
    following = {*NOT_FIRST} & {*re.search("^NEXT (.*)$", run.stdout, re.MULTILINE)[1].split()}
    assert first == set()
    assert "matplotlib" in following


def test_every_example_is_on_a_page():
    pages = "".join((ROOT / page).read_text(encoding="utf-8") for page in PAGES)
    problems = sorted((ROOT / "examples").glob("*.yaml"))
    assert len(problems) > 3
    assert [path.name for path in problems if f"examples/{path.name}" not in pages] == []


def test_the_first_snippets_pass_a_type_checker(tmp_path):
    """As README and the first page on Python have them; control: an attribute of what may be None."""
    snippets = [
        block.text
        for page in ("README.md", "docs/python.md")
        for block in blocks(page)
        if block.kind == "python"
    ]
    files = [tmp_path / f"snippet_{i}.py" for i in range(len(snippets))]
    for file, snippet in zip(files, snippets, strict=True):
        file.write_text(snippet)
    (tmp_path / "wrong.py").write_text(snippets[0].replace("s.bounds", "s.bounds.u"))
    checked = [sys.executable, "-m", "mypy", *map(str, [*files, tmp_path / "wrong.py"])]
    source = os.environ | {"MYPYPATH": str(ROOT / "src")}
    lines = subprocess.run(checked, cwd=ROOT, env=source, capture_output=True, text=True).stdout.splitlines()
    errors = [line for line in lines if ": error: " in line]
    assert len(errors) == 1
    assert 'wrong.py:5: error: Item "None" of "Bounds | None" has no attribute "u"' in errors[0]
