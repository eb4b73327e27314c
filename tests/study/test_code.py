"""The digest of a script's code: what changes it, and what does not."""

import ast
from functools import cache
from pathlib import Path

import grimp
import pytest
from conftest import ROOT, copy_project

from study import code

SCRIPTS = sorted(file.stem for file in (ROOT / "workflow/scripts").glob("*.py") if file.stem != "job")


@pytest.fixture(scope="module")
def project(tmp_path_factory):
    """A copy of the project."""
    return copy_project(tmp_path_factory.mktemp("study"))


@pytest.fixture
def digest_of_change(project, monkeypatch):
    """The digest of the script `cells` where a text in one file is another one, which alone is read anew."""
    monkeypatch.chdir(project)
    read = code._digest_source

    def change(name, old, new, first):
        file = Path(name)
        text = file.read_text()
        assert text.count(old) == 1 or first is not None
        file.write_text(text.replace(old, new, 1))
        try:
            with monkeypatch.context() as changed:
                changed.setattr(
                    code, "_digest_source", lambda item: (read.__wrapped__ if item == file else read)(item)
                )
                return code.digest_program(CELLS)
        finally:
            file.write_text(text)  # all tests share the project

    return change


CELLS = "workflow/scripts/cells.py"
MEASURE = "src/study/experiments/cells/measure.py"
UNCHANGED = {
    "docstring of a module": ("src/unilateral/solvers/uzawa.py", '"""', '"""Edited. ', 0),
    "docstring of a function": (
        MEASURE,
        '"""Write the errors at a',
        '"""Edited. Write the errors at a',
        None,
    ),
    "comment": (MEASURE, "def measure_cells", "# edited\ndef measure_cells", None),
    "layout": (MEASURE, "def measure_cells", "\n\ndef measure_cells", None),
    "another experiment": (
        "src/study/experiments/graded/measure.py",
        "def measure_grading",
        "def other",
        None,
    ),
    "the command line": ("src/unilateral/cli/application.py", "import click", "import click as other", 0),
    "claims of the experiment": ("src/study/experiments/cells/claims.yaml", "claims:", "claims: ", 0),
}
CHANGED = {
    "the function": (MEASURE, "def measure_cells", "def other"),
    "the library": ("src/unilateral/solvers/uzawa.py", "def uzawa(", "def other("),
    "a package": ("src/unilateral/solvers/__init__.py", '"""', 'x = 1\n"""'),
    "data": ("src/study/variables.yaml", "h:", "h2:"),
    "what scripts share": ("workflow/scripts/job.py", "stamp_rule(snakemake.rule)", "stamp_rule('other')"),
    "the script": ("workflow/scripts/cells.py", "params.stop", "params.other"),
}


@pytest.mark.parametrize("name", UNCHANGED)
def test_what_no_result_of_a_script_depends_on_leaves_its_digest(digest_of_change, name):
    assert digest_of_change(*UNCHANGED[name]) == code.digest_program(CELLS)


@pytest.mark.parametrize("name", CHANGED)
def test_what_a_script_runs_or_reads_changes_its_digest(digest_of_change, name):
    """Control."""
    assert digest_of_change(*CHANGED[name], 0) != code.digest_program(CELLS)


@cache
def graph():
    """The project's imports, as import-linter sees them."""
    return grimp.build_graph("benchmarks", "study", "unilateral", cache_dir=None)


def file_of(module):
    folder = "." if module.startswith("benchmarks") else "src"
    path = Path(folder, *module.split("."))
    return path / "__init__.py" if (ROOT / path).is_dir() else path.with_suffix(".py")


@pytest.mark.parametrize("script", SCRIPTS)
def test_the_files_of_a_script_are_those_of_the_modules_that_it_imports(monkeypatch, script):
    """By import-linter's graph from what it and `job` import; and the packages that these are in."""
    monkeypatch.chdir(ROOT)
    program = f"workflow/scripts/{script}.py"
    job = "workflow/scripts/job.py"
    lines = [line.strip() for file in (program, job) for line in Path(file).read_text().splitlines()]
    ours = ("from benchmarks", "from study.", "from unilateral")
    original = {line.split()[1] for line in lines if line.startswith(ours)} | {"study.tables"}
    modules = original | {
        module for module_name in original for module in graph().find_upstream_modules(module_name)
    }
    modules |= {
        ".".join(module.split(".")[:k]) for module in modules for k in range(1, module.count(".") + 1)
    }
    used_files = {file for file in code.used_files(program) if file.suffix == ".py"}
    assert used_files == {Path(program), Path(job), *map(file_of, modules)}


def test_the_data_of_the_ledger_are_those_that_its_modules_name(monkeypatch):
    monkeypatch.chdir(ROOT)
    names = {file.name for file in code.used_files("workflow/scripts/claims.py") if file.suffix == ".yaml"}
    assert {"case.schema.yaml", "polygons.yaml", "variables.yaml", "sections.yaml"} <= names


def test_a_figure_depends_on_its_own_module_and_on_no_other_figure_s(monkeypatch):
    monkeypatch.chdir(ROOT)
    for script in SCRIPTS:
        if script.startswith("draw_"):
            files = code.used_files(f"workflow/scripts/{script}.py")
            assert sum(file.stem.endswith("figure") for file in files) == 1


def find_undigested_lines(source):
    """The lines of a module on which it uses code, or a text for readers, in a way that no digest sees."""
    lines = []
    for node in ast.walk(ast.parse(source)):
        match node:
            case ast.Import(names=names) if any(alias.name == "unilateral" for alias in names):
                lines.append(node.lineno)  # whose names are imported when they are asked for
            case ast.ImportFrom(module="unilateral", names=names):
                modules = {file.stem for file in (ROOT / "src/unilateral").iterdir()} | {"__version__"}
                lines += [node.lineno for alias in names if alias.name not in modules]
            case ast.ImportFrom(level=level) if level:
                lines.append(node.lineno)
            case ast.Name(id="import_module" | "__import__" | "__doc__" | "getdoc"):
                lines.append(node.lineno)
            case ast.Attribute(attr="import_module" | "__doc__" | "getdoc"):
                lines.append(node.lineno)
    return lines


def test_scripts_use_nothing_that_their_digests_do_not_see(monkeypatch):
    monkeypatch.chdir(ROOT)
    programs = [f"workflow/scripts/{script}.py" for script in SCRIPTS]
    files = {file for program in programs for file in code.used_files(program) if file.suffix == ".py"}
    files.remove(Path("src/unilateral/__init__.py"))  # whose public names are for users
    assert len(files) > 200
    assert {
        str(file): lines
        for file in files
        if (lines := find_undigested_lines(file.read_text(encoding="utf-8")))
    } == {}


@pytest.mark.parametrize(
    "line",
    [
        "import unilateral as ul",
        "from unilateral import solve",
        "from . import tables",
        "from .tables import load",
        "importlib.import_module('study.tables')",
        "print(function.__doc__)",
    ],
)
def test_what_digests_do_not_see_is_noticed(line):
    """Control."""
    assert find_undigested_lines(f"x = 1\n{line}") == [2]


def test_imports_of_modules_are_seen():
    assert find_undigested_lines("from unilateral import __version__, errors\nfrom study import tables") == []
