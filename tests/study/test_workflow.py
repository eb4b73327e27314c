"""The pipeline: what a target plans, what its jobs read, write and are given, and what its rules name.

One process plans all jobs. What Snakemake does with them is tested in `test_snakemake.py`, and how a job
runs in `test_jobs.py`.
"""

import ast
import inspect
import json
import re
import subprocess
import sys
from collections import Counter
from functools import cache, reduce
from importlib import import_module
from pathlib import Path

import grimp
import pytest
from conftest import ROOT, copy_project

from study import config as configuration
from study import registry
from study.documents import marks
from study.ledger import claims

WORKFLOW = ROOT / "workflow"
STUDY, SOURCES = configuration.read(sorted(map(str, (WORKFLOW / "config").glob("*.yaml"))))
configuration.check(STUDY, SOURCES, str(WORKFLOW / "schemas/study.schema.yaml"))


@pytest.fixture(scope="module")
def planned(tmp_path_factory):
    """All jobs, of a copy of the project in which nothing is made yet. Snakemake plans for seconds."""
    tree = copy_project(tmp_path_factory.mktemp("study"))
    command = [sys.executable, Path(__file__).with_name("planned.py"), "all", "quick"]
    found = subprocess.run(command, cwd=tree, capture_output=True, text=True, timeout=120)
    assert found.returncode == 0, found.stderr
    return json.loads(found.stdout.splitlines()[-1])


@pytest.fixture
def plan(planned):
    """The jobs that a file or a rule needs: how many of each rule, and their files."""

    def of(target):
        makers = {file: job for job in planned for file in job["output"]}
        waiting = [job for job in planned if target in (job["rule"], *job["output"])]
        assert waiting
        needed = []
        while waiting:
            job = waiting.pop()
            if job not in needed:
                needed.append(job)
                waiting += [makers[file] for file in job["input"] if file in makers]
        files = {file for job in needed for file in [*job["input"], *job["output"]]}
        return files, dict(Counter(job["rule"] for job in needed))

    return of


def built(files):
    """The folders below results/ that they are in."""
    return {file.split("/")[1] for file in files if re.match(r"results/\w+/", file)}


SOLVED = {"solve": 1, "dual_norm": 1}
"""The jobs that make a scene's tables: what all levels need is made once, and one process starts."""
PLANS = {
    "results/square/errors.nc": (SOLVED, {"square"}),
    "results/square/floors.nc": ({**SOLVED, "floors": 1}, {"square"}),
    "figures/rates_square.svg": ({**SOLVED, "rates": 1, "figure": 1}, {"square"}),
    "figures/rates_lshape.svg": ({**SOLVED, "rates": 1, "figure": 1}, {"lshape"}),
    "figures/sharpness.svg": ({"sharpness": 1, "figure": 1}, {"sharpness"}),
    "figures/adaptive.svg": ({"adaptive": 1, "figure": 1}, {"adaptive"}),
    "figures/extremes.svg": ({"extremes": 1, "figure": 1}, {"extremes"}),
    "figures/solution.svg": ({"figure": 1}, set()),
    "quick": ({**SOLVED, "rates": 1, "quick": 1}, {"quick"}),
}
"""What a target needs: how many jobs of which rules, and the folders of results."""


@pytest.mark.parametrize("target", PLANS)
def test_a_target_plans_what_it_needs_and_no_other_scene_or_figure(plan, target):
    files, jobs = plan(target)
    assert (jobs, built(files)) == PLANS[target]
    own = {str(Path(target).with_suffix(kind)) for kind in (".csv", ".svg")} if "figure" in jobs else set()
    assert {file for file in files if re.fullmatch(r"figures/\w+\.(csv|svg)", file)} == own


def test_everything_that_is_computed_is_a_target_of_the_whole_study(plan, planned):
    """So that what is missing is made anew: Snakemake itself does not miss what lies between two files."""
    (targets,) = [job["input"] for job in planned if job["rule"] == "all"]
    files, _ = plan("all")
    computed = {
        file for file in files if file.startswith("results/") and file.endswith((".nc", ".json", ".vtu"))
    }
    assert len(computed) > 50
    assert computed <= set(targets)
    assert {f"results/{name}.nc" for claim in claims.ledger() for name in claim.reads} <= computed


def field(path):
    """A field of the configuration by its path, such as cost.base."""
    return reduce(lambda held, name: held[int(name) if name.isdigit() else name], path.split("."), STUDY)


TABLES = {
    "dual_norm": ["dual_norm.nc"],
    "solve": ["mesh.vtu", "solutions.nc", "errors.nc", "infsup.nc", "timings.nc"],
    "rates": ["rates.nc"],
    "totals": ["totals.nc"],
    "floors": ["floors.nc"],
}
"""What the rules of a scene write, in its folder."""
READ = {
    "solve": {"norm": "dual_norm.nc"},
    "rates": {"errors": "errors.nc"},
    "totals": {"mesh": "mesh.vtu", "solutions": "solutions.nc"},
    "floors": {"errors": "errors.nc"},
}
"""What they read there."""
PARAMS = {
    "dual_norm": {"scene": "scenes.{name}"},
    "solve": {"scene": "scenes.{name}", "stop": "stop"},
    "rates": {"study": "rates", "judged": "scenes.{name}.judged"},
    "totals": {
        "scene": "scenes.{name}",
        "levels": "totals.levels",
        "wanted": "totals.scenes.{name}",
        "ratio": "rates.judged_ratio",
    },
    "floors": {"ratio": "rates.judged_ratio"},
    "surveys": {"study": "surveys", "finds": "finds"},
    "sharpness": {"study": "sharpness", "stop": "stop"},
    "cells": {"study": "cells", "stop": "stop"},
    "graded": {"study": "graded", "stop": "stop"},
    "adaptive": {"study": "adaptive", "stop": "stop"},
    "algorithm": {"study": "algorithm"},
    "extremes": {"study": "extremes"},
}
"""The fields of the configuration that rules are given."""


def of_rules(planned, rules):
    """The jobs of these rules, each of which has one."""
    found = [job for job in planned if job["rule"] in rules]
    assert {job["rule"] for job in found} == set(rules)
    return found


def test_the_tables_of_a_scene_are_made_from_its_own_and_stand_in_its_folder(planned):
    for job in of_rules(planned, TABLES):
        folder = f"results/{job['params']['name']}/"
        assert job["output"] == [folder + name for name in TABLES[job["rule"]]]
        named = {
            name: files for name, files in job["named"].items() if files
        }  # no norm where there is no lambda
        wanted = {name: folder + file for name, file in READ.get(job["rule"], {}).items() if name in named}
        assert named == wanted
        assert named or job["rule"] in ("dual_norm", "solve")
        results = [file for file in job["input"] if file.startswith("results/")]
        assert sorted(results) == sorted(named.values())


def test_a_job_is_given_the_fields_of_the_configuration_that_are_its_own(planned):
    for job in of_rules(planned, PARAMS):
        given = job["params"]
        wanted = {name: field(path.format(**given)) for name, path in PARAMS[job["rule"]].items()}
        assert {name: given[name] for name in wanted} == wanted, job["output"]
        rest = given.keys() - wanted.keys()
        assert rest <= {"job", "name", "number", "scene", "h", "study", "predicted"}, job["rule"]


def test_surveys_write_their_tables_in_their_order(planned):
    (job,) = of_rules(planned, ["surveys"])
    assert job["output"] == [f"results/{name}/infsup.nc" for name in STUDY["surveys"]]


def test_a_job_depends_on_the_cases_of_its_scene(planned):
    """And on no other."""
    cases = {name: scene["cases"] for name, scene in STUDY["scenes"].items()}
    own = {name: STUDY[name]["cases"] for name in ("cells", "algorithm")}
    for job in of_rules(planned, ["dual_norm", "solve", "rates", "totals", "floors", "cells", "algorithm"]):
        wanted = own.get(job["rule"]) or cases[job["params"]["name"]]
        found = [file for file in job["input"] if file.startswith("manufactured/")]
        assert sorted(found) == sorted(f"manufactured/{name}.yaml" for name in wanted)


def test_a_table_of_cost_is_made_for_each_axis_with_the_norms_of_its_scenes(planned):
    """What only documents and figures read is no parameter, so that it runs nothing again."""
    (job,) = of_rules(planned, ["cost"])
    cost = STUDY["cost"]
    assert job["output"] == [f"results/cost/{axis}.nc" for axis in cost["axes"]]
    assert job["named"] == {"norms": [f"results/{scene}/dual_norm.nc" for scene in cost["h"]]}
    assert job["params"]["scene"] == {scene: STUDY["scenes"][scene] for scene in cost["h"]}
    assert cost.keys() - job["params"]["study"].keys() == {"fitted_from", "targets"}


def test_documents_tell_the_numbers_of_the_files_that_experiments_name(planned):
    """Those of `scenes` are of all judged scenes, and of those with totals."""
    (job,) = of_rules(planned, ["numbers"])
    judged = [name for name, scene in STUDY["scenes"].items() if scene["judged"]]
    wanted = {f"results/{scene}/rates.nc" for scene in judged}
    wanted |= {f"results/{scene}/totals.nc" for scene in STUDY["totals"]["scenes"]}
    wanted |= {"results/claims.json", "results/square/floors.nc", "figures/infsup.csv"}
    wanted |= {"benchmarks/installations.json", "benchmarks/whole.json"}
    for experiment in (
        "adaptive",
        "benchmarks",
        "cells",
        "certify",
        "cost",
        "extremes",
        "graded",
        "sharpness",
    ):
        module = import_module(f"study.experiments.{experiment}.numbers")
        wanted |= {*module.READS.values()}
    assert {file for file in job["input"] if not file.startswith(("src/", "workflow/"))} == wanted


def test_the_ledger_is_judged_by_all_tables_that_its_claims_read(planned):
    (job,) = of_rules(planned, ["claims"])
    wanted = {f"results/{name}.nc" for claim in claims.ledger() for name in claim.reads}
    assert (set(job["named"]["tables"]), job["output"]) == (wanted, ["results/claims.json"])


def test_a_figure_of_a_scene_reads_the_tables_of_that_scene(planned):
    """Its name says of which; what a figure reads is named as the file is."""
    found = 0
    for job in of_rules(planned, ["figure"]):
        (scene,) = {Path(file).stem.rpartition("_")[2] for file in job["output"]}
        if scene in STUDY["scenes"]:
            found += 1
            assert built(job["input"]) == {scene}, job["output"]
    assert found > len(STUDY["scenes"]) / 2


def test_a_file_of_results_has_one_rule(planned):
    made = Counter(file for job in planned for file in job["output"])
    assert made
    assert set(made.values()) == {1}


@pytest.fixture
def common(monkeypatch):
    """The names of workflow/rules/common.smk that need nothing of Snakemake."""
    monkeypatch.chdir(ROOT)
    text = (WORKFLOW / "rules/common.smk").read_text()
    source = ast.parse(re.search(r"^@cache.*(?=^def scene_of)", text, re.MULTILINE | re.DOTALL)[0])
    names = {"re": re, "Path": Path, "cache": cache}
    exec(compile(source, "common.smk", "exec"), names)
    return names


@pytest.fixture
def code(common):
    """The rules' function that lists the files that a job's imports lead to."""
    return common["code"]


@cache
def graph():
    """The library's imports, as import-linter sees them."""
    return grimp.build_graph("study", "unilateral", cache_dir=None)


def file_of(module):
    path = ROOT.joinpath("src", *module.split("."))
    return str((path / "__init__.py" if path.is_dir() else path.with_suffix(".py")).relative_to(ROOT))


def imports(modules):
    """All modules that these modules of the library import, by import-linter's graph, and their packages."""
    found = set(modules)
    found |= {each for module in found for each in graph().find_upstream_modules(module)}
    return found | {".".join(each.split(".")[:k]) for each in found for k in range(1, each.count(".") + 2)}


def imported(source):
    """The modules of the library that a source file imports itself, by Python's own parser."""
    nodes = [node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.ImportFrom)]
    names = {f"{node.module}.{alias.name}" for node in nodes for alias in node.names}
    names |= {node.module for node in nodes}
    return names & graph().modules


JOB = (WORKFLOW / "scripts/job.py").read_text()
"""The script of every rule."""


def calls(planned):
    """The jobs that call a function of the study, such as manifest.write_manifest, each with its module."""
    found = [(job, job["params"]["job"].rpartition(".")[0]) for job in planned if "job" in job["params"]]
    assert {job["rule"] for job, _ in found} >= {"solve", "figure", "claims", "manifest", *PARAMS}
    return found


def test_a_rule_depends_on_all_that_its_job_imports_and_on_no_more(planned, code):
    for module in {*(module for _, module in calls(planned)), *registry.figures().values()}:
        found = {file for file in code(module) if file.endswith(".py")}
        wanted = imports({f"study.{module}", *imported(JOB)})
        assert found == {*map(file_of, wanted), "workflow/scripts/job.py"}, module


@pytest.mark.parametrize("module", registry.figures().values())
def test_a_figure_depends_on_its_own_module_and_on_no_other_figure_s(code, module):
    """So a change of one figure's module redraws that figure only."""
    found = [file for file in code("figure_entries", module) if file.endswith(f"{registry.FIGURE}.py")]
    assert found == [f"src/study/{module.replace('.', '/')}.py"]


def test_the_verdicts_depend_on_the_checks_of_all_experiments(planned):
    """Which are imported by their names."""
    used = {claim.check.partition(".")[0] for claim in claims.ledger() if claim.check}
    assert used == set(registry.checks())
    (job,) = of_rules(planned, ["claims"])
    files = {f"src/study/{module.replace('.', '/')}.py" for module in registry.checks().values()}
    assert files <= set(job["input"])


def test_a_rule_depends_on_the_data_that_its_modules_read(code):
    data = {Path(file).name for file in code("ledger.reports") if file.endswith(".yaml")}
    assert data == {"case.schema.yaml", "polygons.yaml", "variables.yaml", "sections.yaml"}


def test_a_solve_depends_on_uzawa_and_not_on_the_figures(code):
    found = code("experiments.scenes.measure")
    assert {"src/unilateral/solvers/uzawa.py", "src/study/scenes.py"} <= set(found)
    assert not [file for file in found if "_figure" in file or "cli" in file]
    assert "src/unilateral/solvers/uzawa.py" not in code("figure_entries", "experiments.scenes.rates_figure")


PEAK = re.compile(r"^done in .* s, with at most (\d+) MB$", re.MULTILINE)
SNAKEMAKE = 350
"""MB that Snakemake's own two processes took in a job of Slurm."""


def over(planned, share=1.0):
    """The jobs of the study that took more than this share of the memory that they ask for, by their logs."""
    told = {job["log"][0]: job for job in planned if job["log"] and not job["log"][0].endswith("/quick.log")}
    peaks = {log: int(PEAK.search((ROOT / log).read_text(encoding="utf-8"))[1]) for log in told}
    assert len(peaks) > 50
    return [log for log, peak in peaks.items() if SNAKEMAKE + peak > share * told[log]["mem_mb"]]


def test_every_job_stayed_below_the_memory_that_it_asks_for(planned):
    assert over(planned) == []


def test_a_further_attempt_asks_for_twice_as_much(common):
    asked = common["asked"](1000, 5)
    assert [asked["mem_mb"]({}, attempt) for attempt in (1, 2, 3)] == [1000, 2000, 4000]
    assert [asked["runtime"]({}, attempt) for attempt in (1, 2, 3)] == [5, 10, 20]


def test_jobs_that_ask_for_too_little_are_noticed(planned):
    """Control: with half of it some are over."""
    assert over(planned, share=0.5)


def test_each_rule_depends_on_its_own_job_and_has_a_log_of_its_name(planned):
    for job, module in calls(planned):
        assert job["script"] == "../scripts/job.py"
        assert file_of(f"study.{module}") in job["input"]
        (log,) = job["log"]
        assert re.fullmatch(rf"results/logs/{job['rule']}(/.*)?\.log", log)


def test_what_is_measured_of_a_job_has_its_rule_s_name_and_is_no_result(planned):
    """Seconds and memory differ from run to run, so nothing reads them, and nothing misses them."""
    measured = {job["rule"]: job["benchmark"] for job in planned if job["benchmark"]}
    assert measured.keys() >= {"solve", "surveys", "sharpness", "adaptive", "extremes", "graded"}
    for rule, path in measured.items():
        assert re.fullmatch(rf"results/benchmarks/{rule}(/.*)?\.tsv", path)
    assert not [file for job in planned for file in job["input"] if file.startswith("results/benchmarks")]


def test_a_rule_s_names_are_the_arguments_of_its_job(planned):
    for job, module in calls(planned):
        function = getattr(import_module(f"study.{module}"), job["params"]["job"].split(".")[-1])
        parameters = inspect.signature(function).parameters.values()
        taken = {"job", *(each.name for each in parameters if each.kind is not each.VAR_KEYWORD)}
        takes_others = any(each.kind is each.VAR_KEYWORD for each in parameters)
        assert taken <= set(job["names"]), job["rule"]
        assert takes_others or taken == set(job["names"]), job["rule"]


def test_no_absolute_path_in_the_workflow():
    for file in [ROOT / "Snakefile", *WORKFLOW.rglob("*.smk"), *WORKFLOW.rglob("*.yaml")]:
        assert not re.search(r"""(^|[\s"'])(/[a-z]\w*/|~/)""", file.read_text()), file


def test_an_edited_document_is_filled_anew(planned):
    """It is an output, and so newer than what it is made from; but its rule is given its digest."""
    (job,) = of_rules(planned, ["documents"])
    assert job["unnamed"] == [[marks.written(ROOT / name) for name in STUDY["documents"]]]
