"""The pipeline: what a target plans, what ends it before it begins, the shape of its scripts."""

import ast
import importlib.util
import inspect
import os
import re
import shutil
import subprocess
import sys
import time
from functools import cache
from pathlib import Path

import grimp
import pytest
import yaml
from conftest import ROOT, copy_project

from unilateral.errors import StorageError
from unilateral.study import drawings, tables
from unilateral.study.judge import claims, ledger

WORKFLOW = ROOT / "workflow"
SCRIPTS = sorted((WORKFLOW / "scripts").glob("*.py"))
LIBRARY = ROOT / "src/unilateral"
STUDY = {
    name: field
    for file in (WORKFLOW / "config").glob("*.yaml")
    for name, field in yaml.safe_load(file.read_text()).items()
}
FIGURE = WORKFLOW / "scripts/make_figure.py"
"""The script that imports the module of a figure by its name."""
STARTS = [(script, "") for script in SCRIPTS if script != FIGURE]
STARTS += [(FIGURE, module) for module in drawings.modules()]


@pytest.fixture(scope="module")
def tree(tmp_path_factory):
    return copy_project(tmp_path_factory.mktemp("study"))


def plan(tree, *target):
    """The text of a dry run, and how many jobs it plans of each rule."""
    command = [sys.executable, "-m", "snakemake", "-n", "-c1", *target]
    found = subprocess.run(command, cwd=tree, capture_output=True, text=True, timeout=60)
    text = found.stdout + found.stderr
    assert found.returncode == 0, text
    table = text.partition("Job stats:")[2].partition("\ntotal ")[0]
    return text, {rule: int(count) for rule, count in re.findall(r"^(\w+) +(\d+)$", table, re.MULTILINE)}


def built(text):
    """The folders below results/ that a plan names."""
    return set(re.findall(r"\bresults/(\w+)/", text))


def jobs_of_a_scene():
    """The rules of its tables, a job each: what all levels need is made once, and one process starts."""
    return {"solve": 1, "dual_norm": 1}


def test_a_table_plans_no_figure_and_no_other_scene(tree):
    text, jobs = plan(tree, "results/square/errors.nc")
    assert jobs == jobs_of_a_scene()
    assert built(text) == {"square"}
    assert "figures/" not in text


def test_a_figure_plans_its_own_scene_only(tree):
    text, jobs = plan(tree, "figures/rates_square.svg")
    assert jobs == {**jobs_of_a_scene(), "rates": 1, "figure": 1}
    assert built(text) == {"square"}
    assert set(re.findall(r"figures/\w+\.\w+", text)) == {"figures/rates_square.svg"}


def test_one_figure_of_the_lshape_plans_no_other_scene(tree):
    text, jobs = plan(tree, "figures/rates_lshape.svg")
    assert jobs == {**jobs_of_a_scene(), "rates": 1, "figure": 1}
    assert built(text) == {"lshape"}


def test_the_sharpness_study_plans_one_job_and_no_scene(tree):
    text, jobs = plan(tree, "figures/sharpness.svg")
    assert jobs == dict.fromkeys(("sharpness", "figure"), 1)
    assert built(text) == {"sharpness"}


def test_adapted_meshes_plan_one_job_and_no_scene(tree):
    text, jobs = plan(tree, "figures/adaptive.svg")
    assert jobs == dict.fromkeys(("adaptive", "figure"), 1)
    assert built(text) == {"adaptive"}


def test_the_extremes_plan_one_job_and_no_scene(tree):
    text, jobs = plan(tree, "figures/extremes.svg")
    assert jobs == dict.fromkeys(("extremes", "figure"), 1)
    assert built(text) == {"extremes"}


def test_floors_plan_their_scene_without_rates(tree):
    text, jobs = plan(tree, "results/square/floors.nc")
    assert jobs == {**jobs_of_a_scene(), "floors": 1}
    assert built(text) == {"square"}


def test_quick_plans_the_quick_scene_only(tree):
    text, jobs = plan(tree, "quick")
    assert jobs == {**jobs_of_a_scene(), "rates": 1, "quick": 1}
    assert built(text) == {"quick"}


def test_large_meshes_are_a_job_each_and_no_part_of_the_whole_study(tree):
    text, jobs = plan(tree, "deep")
    assert jobs == {"deep_level": len(STUDY["deep"]["h"]), "deep_levels": 1, "deep": 1}
    assert built(text) == {"deep"}
    assert "deep" not in built(plan(tree)[0])


def test_everything_that_is_computed_is_a_target_of_the_whole_study(tree):
    """So that what is missing is made anew: Snakemake itself does not miss what lies between two files."""
    text, _ = plan(tree)
    targets = re.search(r"^rule all:\n    input: (.*)$", text, re.MULTILINE)[1].split(", ")
    command = [sys.executable, "-m", "snakemake", "--summary"]
    found = subprocess.run(command, cwd=tree, capture_output=True, text=True, timeout=60)
    files = [line.split("\t")[0] for line in found.stdout.splitlines()[1:]]
    computed = {
        file for file in files if file.startswith("results/") and file.endswith((".nc", ".json", ".vtu"))
    }
    assert len(computed) > 50
    assert computed <= set(targets)
    assert {f"results/{name}.nc" for claim in claims.ledger() for name in claim.reads} <= computed


SOLVED = ("mesh.vtu", "solutions.nc", "errors.nc", "infsup.nc", "timings.nc")
QUICK = [
    ("dual_norm.nc", "dual_norm"),
    *((name, "solve") for name in SOLVED),
    ("rates.nc", "rates"),
]
"""Files of the scene `quick` and their rules, in the order in which they are made."""


@pytest.fixture
def computed(tree):
    """The project with files in place of the scene's results."""
    folder = tree / "results/quick"
    folder.mkdir(parents=True)
    for i, (name, _) in enumerate(QUICK):
        (folder / name).write_text("a result")
        os.utime(folder / name, (time.time() + i, time.time() + i))
    yield folder
    shutil.rmtree(tree / "results")


def test_what_is_there_is_not_made_anew(tree, computed):
    """Control."""
    assert "Nothing to be done" in plan(tree, "quick", "--rerun-triggers", "mtime")[0]


@pytest.mark.parametrize(("name", "rule"), QUICK)
def test_what_is_missing_is_made_anew_with_what_follows_from_it(tree, computed, name, rule):
    (computed / name).unlink()
    _, jobs = plan(tree, "quick", "--rerun-triggers", "mtime")
    assert jobs[rule] == 1
    assert jobs["rates"] == 1


@pytest.mark.parametrize(("name", "rule"), [QUICK[i] for i in (0, 2, 3)])
def test_one_command_makes_a_damaged_file_anew(tree, computed, name, rule):
    """The one that messages name."""
    assert plan(tree, "-f", f"results/quick/{name}", "--rerun-triggers", "mtime")[1] == {rule: 1}
    with pytest.raises(StorageError, match=f"; 'snakemake -j2 -f .*/results/quick/{name}' makes it anew"):
        tables.load(computed / name)


def test_a_damaged_mesh_says_how_it_is_made_anew(computed):
    """An emptied one, as bound_totals.py reads it."""
    (computed / "mesh.vtu").write_text("")
    found, _ = ended(f"scenes.stored_mesh({str(computed / 'mesh.vtu')!r}, {{'polygon': 'square'}})", computed)
    said = r"unilateral: .*mesh\.vtu: no mesh can be read .*; 'snakemake -j2 -f .*mesh\.vtu' makes it anew\n"
    assert re.fullmatch(said, found.stderr)
    assert found.returncode == 4


def test_a_portrait_needs_no_results(tree):
    text, jobs = plan(tree, "figures/solution.svg")
    assert jobs == {"figure": 1}
    assert built(text) == set()


REFUSED = [
    (
        ("study", "levels: 4 }", "levels: four }"),
        "workflow/config/study.yaml, field scenes.quick.mesh.levels: it is 'four'; it has to be a whole "
        "number, at least 1, at most 9",
    ),
    (
        ("study", "    cases: [natural, thirds]\n", "    cases: [natural, reentrant]\n"),
        "workflow/config/study.yaml, field scenes.quick.cases[1]: case 'reentrant' is for lshape, not for "
        "'square'",
    ),
    (
        ("rates", "    smooth:", "    smoother:"),
        "workflow/config/rates.yaml, field rates.cases: there is no 'smooth'; add it, for scene 'square' has "
        "that case",
    ),
    (
        ("study", "judged: false", "judged: false\n    judged: true"),
        "workflow/config/study.yaml is not a YAML file: the field 'judged' is given twice",
    ),
]


@pytest.mark.parametrize(("change", "said"), REFUSED)
def test_a_bad_configuration_is_refused_in_one_line_before_anything_runs(tree, change, said):
    """Also by a dry run, and whatever the target is."""
    name, old, new = change
    file = tree / f"workflow/config/{name}.yaml"
    kept = file.read_text()
    assert kept.count(old) == 1
    file.write_text(kept.replace(old, new))
    command = [sys.executable, "-m", "snakemake", "-n", "-c1", "figures/solution.svg"]
    found = subprocess.run(command, cwd=tree, capture_output=True, text=True, timeout=60)
    file.write_text(kept)
    assert (found.returncode, found.stderr) == (2, f"unilateral: {said}\n")


def test_a_parameter_from_the_command_line_is_checked_too(tree):
    command = [sys.executable, "-m", "snakemake", "-n", "-c1", "quick", "--config", "stop=4"]
    found = subprocess.run(command, cwd=tree, capture_output=True, text=True, timeout=60)
    assert found.returncode == 2
    assert "field stop: it is 4; it has to be a mapping" in found.stderr


@pytest.fixture
def code(monkeypatch):
    """The rules' function that lists the files that a script's imports lead to."""
    monkeypatch.chdir(ROOT)
    text = (WORKFLOW / "rules/common.smk").read_text()
    source = ast.parse(re.search(r"^@cache.*(?=^def scene_of)", text, re.MULTILINE | re.DOTALL)[0])
    names = {"re": re, "Path": Path, "cache": cache}
    exec(compile(source, "common.smk", "exec"), names)
    return names["code"]


@cache
def graph():
    """The library's imports, as import-linter sees them."""
    return grimp.build_graph("unilateral", cache_dir=None)


def file_of(module):
    path = LIBRARY.joinpath(*module.split(".")[1:])
    return str((path / "__init__.py" if path.is_dir() else path.with_suffix(".py")).relative_to(ROOT))


def imported(script):
    """The modules that a script and its neighbours import, by Python's own parser."""
    names = set()
    for node in ast.walk(ast.parse(script.read_text())):
        if isinstance(node, ast.ImportFrom):
            names |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
        elif isinstance(node, ast.Import):
            assert not any("unilateral" in alias.name for alias in node.names), script
    neighbours = [other for other in SCRIPTS if other.stem in names and other != script]
    return names | {name for other in neighbours for name in imported(other)}


@pytest.mark.parametrize(("script", "module"), STARTS, ids=lambda start: getattr(start, "stem", start))
def test_a_rule_depends_on_all_that_its_script_imports_and_on_no_more(code, script, module):
    """And on its figure's module, if it draws one."""
    name = f"study.figures.{module}" if module else ""
    used = imported(script) & graph().modules | ({f"unilateral.{name}"} if module else set())
    used |= {each for module in used for each in graph().find_upstream_modules(module)}
    used |= {".".join(each.split(".")[:k]) for each in used for k in range(1, each.count(".") + 2)}
    found = {file for file in code(script.stem, name) if file.endswith(".py") and "scripts" not in file}
    assert found == {file_of(each) for each in used}


@pytest.mark.parametrize("module", drawings.modules())
def test_a_figure_depends_on_its_own_module_and_on_no_other_figure_s(code, module):
    """So a change of one figure's module redraws that figure only."""
    found = [
        Path(file).stem for file in code(FIGURE.stem, f"study.figures.{module}") if "study/figures" in file
    ]
    assert sorted(found) == sorted(["__init__", "style", module])


def test_a_rule_depends_on_the_data_that_its_modules_read(code):
    data = {Path(file).name for file in code("judge_claims") if file.endswith(".yaml")}
    assert data == {"case.schema.yaml", "polygons.yaml", "variables.yaml", *ledger.FILES}


def test_a_solve_depends_on_uzawa_and_not_on_the_figures(code):
    found = code("solve_scene")
    assert {"src/unilateral/solvers/uzawa.py", "src/unilateral/study/scenes.py"} <= set(found)
    assert not [file for file in found if "figures" in file or "cli" in file]
    assert "src/unilateral/solvers/uzawa.py" not in code(FIGURE.stem, "study.figures.rates")


def each_rule():
    """The text of each rule that runs a script, and the script."""
    texts = re.split(r"^rule ", rules(), flags=re.MULTILINE)[1:]
    return [(text, re.search(r'"\.\./scripts/(\w+)\.py"', text)[1]) for text in texts]


def test_each_rule_depends_on_its_own_script_and_has_a_log_of_its_name():
    for text, script in each_rule():
        assert re.search(r'code\("(\w+)"', text)[1] == script
        name = text.partition(":")[0]
        assert re.search(rf'^    log:\n        "results/logs/{name}(/.*)?\.log",$', text, re.MULTILINE), name


def test_what_is_measured_of_a_job_has_its_rule_s_name_and_is_no_result(tree):
    """Seconds and memory differ from run to run, so nothing reads them, and nothing misses them."""
    measured, pattern = {}, r'^    benchmark:\n        "results/benchmarks/(\w+).*\.tsv"$'
    for text, _ in each_rule():
        for name in re.findall(pattern, text, re.MULTILINE):
            measured[text.partition(":")[0]] = name
    assert measured == {name: name for name in ("solve", "survey", "sharpness", "adaptive", "extremes")}
    assert "results/benchmarks" not in plan(tree)[0]


def test_snakemake_s_linter_has_one_complaint():
    """That a rule with a script names no conda environment or container.

    The study is installed by pip from a lock with hashes, for all rules at once. An environment or a
    container that nobody builds would silence the linter and say nothing true.
    """
    command = [sys.executable, "-m", "snakemake", "--lint"]
    told = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=60).stderr
    complaints = re.findall(r"^Lints for (.*?) \(.*\n((?:    .*\n)+)", told, re.MULTILINE)
    titles = {where: re.findall(r"^    \* (.*)$", lints, re.MULTILINE) for where, lints in complaints}
    one = ["Specify a conda environment or container for each rule.:"]
    assert titles == {f"rule {text.partition(':')[0]}": one for text, _ in each_rule()}


def given(text):
    """The names of a rule's input, output and params; `**` where more follow from the configuration."""
    parts = re.findall(r"^    (?:input|output|params):\n((?: {8}.*\n)+)", text, re.MULTILINE)
    names = re.findall(r"^ {8}(?:(\w+)=|\*\*|unpack\()", "".join(parts), re.MULTILINE)
    return {name or "**" for name in names}


def taken(script):
    """The arguments of the function that a script runs; `**` where it takes others, too."""
    function = re.search(r"^    run\((\w+), snakemake\)$", script.read_text(), re.MULTILINE)[1]
    spec = importlib.util.spec_from_file_location(script.stem, script)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    parameters = inspect.signature(getattr(module, function)).parameters.values()
    return {"**" if each.kind is each.VAR_KEYWORD else each.name for each in parameters}


def test_a_rule_s_names_are_the_arguments_of_its_script(monkeypatch):
    monkeypatch.syspath_prepend(WORKFLOW / "scripts")
    for text, script in each_rule():
        wanted = taken(WORKFLOW / f"scripts/{script}.py")
        assert wanted <= given(text), script
        assert "**" in wanted or wanted == given(text), script


def test_the_names_of_a_rule_are_found():
    """Control."""
    text = 'a:\n    input:\n        "x",\n        **{b: c},\n        d="e",\n    output:\n        f="g",\n'
    assert given(text) == {"**", "d", "f"}


def rules():
    return "".join(file.read_text() for file in sorted((WORKFLOW / "rules").glob("*.smk")))


def guard(tree):
    return [node for node in tree.body if isinstance(node, ast.If) and "__name__" in ast.unparse(node.test)]


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.stem)
def test_a_script_uses_snakemake_under_its_main_guard_only(script):
    tree = ast.parse(script.read_text())
    assert ast.get_docstring(tree)
    guarded = [id(node) for top in guard(tree) for node in ast.walk(top)]
    names = [node for node in ast.walk(tree) if isinstance(node, ast.Name) and node.id == "snakemake"]
    assert all(id(node) in guarded for node in names)
    assert bool(names) == (script.name != "job.py")
    allowed = (ast.Import, ast.ImportFrom, ast.FunctionDef, ast.If, ast.Expr)
    assert all(isinstance(node, allowed) for node in tree.body)
    assert len(guard(tree)) == sum(isinstance(node, ast.If) for node in tree.body)


def parameters(source):
    """The numbers in a source file that are not 0 or 1."""
    constants = [node.value for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Constant)]
    return [value for value in constants if isinstance(value, int | float) and value not in (0, 1)]


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.stem)
def test_a_script_holds_no_parameter_and_no_path(script):
    text = script.read_text()
    assert parameters(text) == []
    assert not re.search(r"""["'](/|~|\.\./|results|figures)""", text)


def test_a_hidden_parameter_would_be_found():
    """Control."""
    assert parameters("h = [1 / 8, x[-1], -0.5]") == [8, 0.5]


def test_no_absolute_path_in_the_workflow():
    for file in [ROOT / "Snakefile", *WORKFLOW.rglob("*.smk"), *WORKFLOW.rglob("*.yaml")]:
        assert not re.search(r"""(^|[\s"'])(/[a-z]\w*/|~/)""", file.read_text()), file


def ended(statements, folder):
    """How a script ends whose `main` consists of these statements, and its log."""
    code = "import os, warnings; from types import SimpleNamespace; from job import run; "
    code += f"from unilateral import errors; from unilateral.study import scenes\ndef main(): {statements}\n"
    log = folder / "job.log"
    code += f"run(main, SimpleNamespace(input={{}}, output={{}}, params={{}}, log=[{str(log)!r}]))"
    command = [sys.executable, "-c", code]
    found = subprocess.run(command, cwd=WORKFLOW / "scripts", capture_output=True, text=True, timeout=60)
    assert found.stdout == ""
    return found, log.read_text()


@pytest.mark.parametrize(
    ("fault", "code", "said"),
    [
        ("errors.InputError('case x: u < g')", 2, "unilateral: case x: u < g\n"),
        ("errors.StorageError('x.nc is damaged')", 4, "unilateral: x.nc is damaged\n"),
    ],
)
def test_bad_input_and_bad_files_end_a_script_in_one_sentence(tmp_path, fault, code, said):
    """On the terminal, and as the last line of the log, where what was said before stands, too."""
    found, log = ended(f"print('a table'); raise {fault}", tmp_path)
    assert (found.returncode, found.stderr) == (code, said)
    assert log == f"a table\n{said}"


def test_any_other_error_leaves_its_traceback_in_the_log(tmp_path):
    found, log = ended("raise KeyError('x')", tmp_path)
    said = f"unilateral: KeyError: 'x'; the traceback is in {tmp_path / 'job.log'}\n"
    assert (found.returncode, found.stderr) == (1, said)
    assert log.startswith("Traceback")
    assert log.endswith(f"\nKeyError: 'x'\n{said}")


def test_all_that_a_job_says_is_in_its_log_in_order(tmp_path):
    """Lines, warnings, and what a library writes past Python; on the terminal there is nothing."""
    found, log = ended("print('a'); warnings.warn('b'); os.system('echo c'); print('d')", tmp_path)
    assert (found.returncode, found.stderr) == (0, "")
    assert re.fullmatch(r"a\n.*UserWarning: b\nc\nd\ndone in [\d.]+ s, with at most \d+ MB\n", log)


def test_a_failing_job_says_why_and_leaves_nothing_half_written(tree, computed):
    """The dual norm that it reads is no table."""
    left = set(computed.iterdir()) - {computed / name for name in SOLVED}
    command = [sys.executable, "-m", "snakemake", "-c1", "-f", "results/quick/errors.nc"]
    command += ["--rerun-triggers", "mtime"]
    found = subprocess.run(command, cwd=tree, capture_output=True, text=True, timeout=60)
    said = re.findall(
        r"^unilateral: .*dual_norm\.nc is damaged .*\n", found.stdout + found.stderr, re.MULTILINE
    )
    assert (found.returncode, len(said)) == (1, 1)
    assert (tree / "results/logs/solve/quick.log").read_text() == said[0]
    assert set(computed.iterdir()) == left


def test_cases_of_a_scene_are_certified(tmp_path):
    """A case whose gap is negative next to its transition does not get into the study."""
    text = (ROOT / "manufactured/thirds.yaml").read_text().replace("pos(1/3 - t, 3/2)", "pos(1/2 - t, 3/2)")
    (tmp_path / "broken.yaml").write_text(text)
    scene = {"polygon": "square", "side": 0, "cases": [str(tmp_path / "broken.yaml")]}
    found, _ = ended(f"scenes.cases({scene!r})", tmp_path)
    assert re.fullmatch(r"unilateral: case 'broken' .*lambda \(u - g\) is not 0.*\n", found.stderr)


ACCEPTED = {"Specify a conda environment or container for each rule."}
"""All rules run in the one environment that holds the locked packages, and Snakemake itself: .venv. A rule of
its own could only repeat it, in a second way to set it up."""


def lints(folder):
    """The titles of what Snakemake's linter says of the Snakefile in a folder."""
    command = [sys.executable, "-m", "snakemake", "--lint"]
    found = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=60)
    assert "Lints for" in found.stderr, found.stderr
    return set(re.findall(r"^    \* (.*):$", found.stderr, re.MULTILINE))


def test_snakemake_s_linter_has_nothing_else_to_say(tree):
    assert lints(tree) <= ACCEPTED


def test_a_rule_without_a_log_would_be_found(tmp_path):
    """Control."""
    (tmp_path / "Snakefile").write_text("rule made:\n    output: 'x'\n    shell: 'touch x'\n")
    assert lints(tmp_path) - ACCEPTED == {"No log directive defined"}
