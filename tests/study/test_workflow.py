"""The pipeline: what a target plans, what its jobs read, write and are given, and what its rules name.

One process plans all jobs. What Snakemake does with them is tested in `test_snakemake.py`, and how a job
runs in `test_jobs.py`.
"""

import contextlib
import json
import re
import subprocess
import sys
from collections import Counter
from functools import cache, reduce
from pathlib import Path

import pytest
from conftest import ROOT, copy_project

from study import code
from study import config as configuration
from study.documents import marks
from study.ledger import claims

WORKFLOW = ROOT / "workflow"
SCRIPTS = sorted(file for file in (WORKFLOW / "scripts").glob("*.py") if file.stem != "job")
STUDY, SOURCES = configuration.read_configuration(sorted(map(str, (WORKFLOW / "config").glob("*.yaml"))))
configuration.check(STUDY, SOURCES, str(WORKFLOW / "schemas/study.schema.yaml"))


@pytest.fixture(scope="module")
def planned_jobs(tmp_path_factory):
    """All jobs, of a copy of the project in which nothing is made yet. Snakemake plans for seconds."""
    tree = copy_project(tmp_path_factory.mktemp("study"))
    command = [sys.executable, Path(__file__).with_name("planned.py"), "all", "quick"]
    process = subprocess.run(command, cwd=tree, capture_output=True, text=True, timeout=120)
    assert process.returncode == 0, process.stderr
    return json.loads(process.stdout.splitlines()[-1])


@pytest.fixture
def plan(planned_jobs):
    """The jobs that a file or a rule needs: how many of each rule, and their files."""

    def list_needed_jobs(target):
        makers = {file: job for job in planned_jobs for file in job["output"]}
        waiting = [job for job in planned_jobs if target in (job["rule"], *job["output"])]
        assert waiting
        needed = []
        while waiting:
            job = waiting.pop()
            if job not in needed:
                needed.append(job)
                waiting += [makers[file] for file in job["input"] if file in makers]
        files = {file for job in needed for file in [*job["input"], *job["output"]]}
        return files, dict(Counter(job["rule"] for job in needed))

    return list_needed_jobs


def built(files):
    """The folders below results/ that they are in."""
    return {file.split("/")[1] for file in files if re.match(r"results/\w+/", file)}


SOLVED = {"solve": 1, "dual_norm": 1}
"""The jobs that make a scene's tables: what all levels need is made once, and one process starts."""
PLANS = {
    "results/square/errors.nc": (SOLVED, {"square"}),
    "results/square/floors.nc": ({**SOLVED, "floors": 1}, {"square"}),
    "results/square/u_in_l2.nc": ({**SOLVED, "u_in_l2": 1}, {"square"}),
    "figures/rates_square.svg": ({**SOLVED, "rates": 1, "draw_rates": 1}, {"square"}),
    "figures/rates_lshape.svg": ({**SOLVED, "rates": 1, "draw_rates": 1}, {"lshape"}),
    "figures/sharpness.svg": ({"sharpness": 1, "draw_sharpness": 1}, {"sharpness"}),
    "figures/adaptive.svg": ({"adaptive": 1, "draw_adaptive": 1}, {"adaptive"}),
    "figures/extremes.svg": ({"extremes": 1, "draw_extremes": 1}, {"extremes"}),
    "figures/reaction.svg": ({"extremes": 1, "draw_reaction": 1}, {"extremes"}),
    "figures/solution.svg": ({"draw_solution": 1}, set()),
    "quick": ({**SOLVED, "rates": 1, "quick": 1}, {"quick"}),
}
"""What a target needs: how many jobs of which rules, and the folders of results."""


@pytest.mark.parametrize("target", PLANS)
def test_a_target_plans_what_it_needs_and_no_other_scene_or_figure(plan, target):
    files, jobs = plan(target)
    assert (jobs, built(files)) == PLANS[target]
    outputs = (
        {str(Path(target).with_suffix(kind)) for kind in (".csv", ".svg")}
        if target.startswith("figures")
        else set()
    )
    assert {file for file in files if re.fullmatch(r"figures/\w+\.(csv|svg)", file)} == outputs


def test_everything_that_is_computed_is_a_target_of_the_whole_study(plan, planned_jobs):
    """So that what is missing is made anew: Snakemake itself does not miss what lies between two files."""
    (targets,) = [job["input"] for job in planned_jobs if job["rule"] == "all"]
    files, _ = plan("all")
    result_files = {
        file for file in files if file.startswith("results/") and file.endswith((".nc", ".json", ".vtu"))
    }
    assert len(result_files) > 50
    assert result_files <= set(targets)
    assert {f"results/{name}.nc" for claim in claims.load_ledger() for name in claim.reads} <= result_files


def field(path):
    """A field of the configuration by its path, such as cost.base."""
    return reduce(lambda branch, name: branch[int(name) if name.isdigit() else name], path.split("."), STUDY)


TABLES = {
    "dual_norm": ["dual_norm.nc"],
    "solve": ["mesh.vtu", "solutions.nc", "errors.nc", "infsup.nc", "timings.nc"],
    "rates": ["rates.nc"],
    "totals": ["totals.nc"],
    "floors": ["floors.nc"],
    "u_in_l2": ["u_in_l2.nc"],
}
"""What the rules of a scene write, in its folder."""
READ = {
    "solve": {"norm": "dual_norm.nc"},
    "rates": {"errors": "errors.nc"},
    "totals": {"mesh": "mesh.vtu", "solutions": "solutions.nc"},
    "floors": {"errors": "errors.nc"},
    "u_in_l2": {"mesh": "mesh.vtu"},
}
"""What they read there."""
PARAMS = {
    "dual_norm": {"scene": "scenes.{scene}"},
    "solve": {"scene": "scenes.{scene}", "stop": "stop"},
    "rates": {"study": "rates", "judged": "scenes.{scene}.judged"},
    "totals": {
        "scene": "scenes.{scene}",
        "levels": "totals.levels",
        "case_names": "totals.scenes.{scene}",
        "ratio": "rates.judged_ratio",
    },
    "floors": {"ratio": "rates.judged_ratio"},
    "u_in_l2": {"scene": "scenes.{scene}", "stop": "stop", "ratio": "rates.judged_ratio"},
    "surveys": {"study": "surveys", "finds": "finds"},
    "sharpness": {"study": "sharpness", "stop": "stop"},
    "cells": {"study": "cells", "stop": "stop"},
    "graded": {"study": "graded", "stop": "stop"},
    "adaptive": {"study": "adaptive", "stop": "stop"},
    "algorithm": {"study": "algorithm"},
    "extremes": {"study": "extremes"},
}
"""The fields of the configuration that rules are given."""


def select_rules(planned, rules):
    """The jobs of these rules, each of which has one."""
    jobs = [job for job in planned if job["rule"] in rules]
    assert {job["rule"] for job in jobs} == set(rules)
    return jobs


def test_the_tables_of_a_scene_are_made_from_its_own_and_stand_in_its_folder(planned_jobs):
    for job in select_rules(planned_jobs, TABLES):
        folder = f"results/{job['wildcards']['scene']}/"
        assert job["output"] == [folder + name for name in TABLES[job["rule"]]]
        named = {
            name: files for name, files in job["named"].items() if files
        }  # no norm where there is no lambda
        expected = {name: folder + file for name, file in READ.get(job["rule"], {}).items() if name in named}
        assert named == expected
        assert named or job["rule"] in ("dual_norm", "solve")
        results = [file for file in job["input"] if file.startswith("results/")]
        assert sorted(results) == sorted(named.values())


def test_a_job_is_given_the_fields_of_the_configuration_that_are_its_own(planned_jobs):
    for job in select_rules(planned_jobs, PARAMS):
        params = job["params"]
        expected_fields = {
            name: field(path.format(**job["wildcards"])) for name, path in PARAMS[job["rule"]].items()
        }
        assert {name: params[name] for name in expected_fields} == expected_fields, job["output"]
        remaining = params.keys() - expected_fields.keys()
        assert remaining == {"code"}, job["rule"]


def test_surveys_write_their_tables_in_their_order(planned_jobs):
    (job,) = select_rules(planned_jobs, ["surveys"])
    assert job["output"] == [f"results/{name}/infsup.nc" for name in STUDY["surveys"]]


def test_a_job_depends_on_the_cases_of_its_scene(planned_jobs):
    """And on no other."""
    cases = {name: scene["cases"] for name, scene in STUDY["scenes"].items()}
    original = {name: STUDY[name]["cases"] for name in ("cells", "algorithm")}
    for job in select_rules(
        planned_jobs, ["dual_norm", "solve", "rates", "totals", "floors", "u_in_l2", "cells", "algorithm"]
    ):
        expected = original.get(job["rule"]) or cases[job["wildcards"]["scene"]]
        files = [file for file in job["input"] if file.startswith("manufactured/")]
        assert sorted(files) == sorted(f"manufactured/{name}.yaml" for name in expected)


def test_a_table_of_cost_is_made_for_each_axis_with_the_norms_of_its_scenes(planned_jobs):
    """What only documents and figures read is no parameter, so that it runs nothing again."""
    (job,) = select_rules(planned_jobs, ["cost"])
    cost = STUDY["cost"]
    assert job["output"] == [f"results/cost/{axis}.nc" for axis in cost["axes"]]
    assert job["named"] == {"norms": [f"results/{scene}/dual_norm.nc" for scene in cost["h"]]}
    assert job["params"]["scene"] == {scene: STUDY["scenes"][scene] for scene in cost["h"]}
    assert cost.keys() - job["params"]["study"].keys() == {"fitted_from", "targets"}


BENCHMARKS = [
    "installations.json",
    "whole.json",
    "results.nc",
    "scores.csv",
    "commands.json",
    "trust.json",
    "precision.json",
]
TOLD = {
    "adaptive": ["errors", "infsup", "rates"],
    "cells": ["errors", "alternating"],
    "certain": ["contact"],
    "certify": ["solutions"],
    "cost": ["algorithm", "case", "scene", "algebra", "precision"],
    "extremes": ["extremes", "reaction"],
    "graded": ["errors", "adapted"],
    "multipliers": ["errors"],
    "sharpness": ["rates"],
}
"""The tables of experiments of which documents tell."""


def test_documents_tell_the_numbers_of_the_files_that_experiments_name(planned_jobs):
    """Those of `scenes` are of all judged scenes, and of those with totals."""
    (job,) = select_rules(planned_jobs, ["document_numbers"])
    judged = [name for name, scene in STUDY["scenes"].items() if scene["judged"]]
    expected = {f"results/{scene}/rates.nc" for scene in judged}
    expected |= {f"results/{scene}/totals.nc" for scene in STUDY["totals"]["scenes"]}
    expected |= {f"results/{scene}/u_in_l2.nc" for scene in STUDY["u_in_l2"]}
    expected |= {"results/claims.json", "figures/infsup.csv"}
    expected |= {f"results/square/{table}.nc" for table in ("floors", "errors")}
    expected |= {f"benchmarks/{name}" for name in BENCHMARKS}
    for experiment, tables in TOLD.items():
        expected |= {f"results/{experiment}/{table}.nc" for table in tables}
    assert set(job["input"]) == expected


def test_the_ledger_is_judged_by_all_tables_that_its_claims_read(planned_jobs):
    (job,) = select_rules(planned_jobs, ["claims"])
    expected = {f"results/{name}.nc" for claim in claims.load_ledger() for name in claim.reads}
    assert (set(job["named"]["tables"]), job["output"]) == (expected, ["results/claims.json"])


def test_a_figure_of_a_scene_reads_the_tables_of_that_scene(planned_jobs):
    """Its name says of which; what a figure reads is named as the file is."""
    count = 0
    for job in select_rules(planned_jobs, ["draw_rates"]):
        (scene,) = {Path(file).stem.rpartition("_")[2] for file in job["output"]}
        if scene in STUDY["scenes"]:
            count += 1
            assert built(job["input"]) == {scene}, job["output"]
    assert count == len(STUDY["figures"]["rates"]["scenes"])


def test_a_file_of_results_has_one_rule(planned_jobs):
    counter = Counter(file for job in planned_jobs for file in job["output"])
    assert counter
    assert set(counter.values()) == {1}


def test_the_stored_manifest_names_every_file_and_its_rule(plan, planned_jobs):
    """Those that the whole study makes, but those of the machine, the manifest, and what is told of it."""
    files, _ = plan("all")
    planned_files = {(file, job["rule"]) for job in planned_jobs for file in job["output"] if file in files}
    expected = {
        (file, rule)
        for file, rule in planned_files
        if not file.endswith("timings.nc") and rule not in ("manifest", "pages", "curves")
    }
    manifest = json.loads((ROOT / "results/manifest.json").read_text())["files"]
    assert {(file["path"], file["rule"]) for file in manifest} == expected
    assert len(manifest) > 100


PEAK = re.compile(r"^done in .* with at most (\d+) MB$", re.MULTILINE)
SNAKEMAKE = 350
"""MB that Snakemake's own two processes took in a job of Slurm."""


def select_above_share(planned, share=1.0):
    """The jobs of the study that took more than this share of the memory that they ask for, by their logs."""
    jobs = {job["log"][0]: job for job in planned if job["log"] and not job["log"][0].endswith("/quick.log")}
    peaks = {log: int(PEAK.search((ROOT / log).read_text(encoding="utf-8"))[1]) for log in jobs}
    assert len(peaks) > 50
    return [log for log, peak in peaks.items() if SNAKEMAKE + peak > share * jobs[log]["mem_mb"]]


def test_every_job_stayed_below_the_memory_that_it_asks_for(planned_jobs):
    assert select_above_share(planned_jobs) == []


def test_a_further_attempt_asks_for_twice_as_much():
    text = (WORKFLOW / "rules/common.smk").read_text()
    names = {}
    exec(re.search(r"^def asked.*?(?=^SOLVES)", text, re.MULTILINE | re.DOTALL)[0], names)
    asked = names["asked"](1000, 5)
    assert [asked["mem_mb"]({}, attempt) for attempt in (1, 2, 3)] == [1000, 2000, 4000]
    assert [asked["runtime"]({}, attempt) for attempt in (1, 2, 3)] == [5, 10, 20]


def test_jobs_that_ask_for_too_little_are_noticed(planned_jobs):
    """Control: with half of it some are over."""
    assert select_above_share(planned_jobs, share=0.5)


def test_each_rule_has_its_script_its_code_and_a_log_of_its_name(planned_jobs):
    """The code is a parameter, so a change of it runs the job again."""
    scripts = [job for job in planned_jobs if job["script"]]
    assert {job["rule"] for job in scripts} == {file.stem for file in SCRIPTS}
    for job in scripts:
        assert job["script"] == f"../scripts/{job['rule']}.py"
        assert job["params"]["code"] == digest(job["rule"])
        (log,) = job["log"]
        assert re.fullmatch(rf"results/logs/{job['rule']}(/.*)?\.log", log)


@cache
def digest(rule):
    with contextlib.chdir(ROOT):
        return code.digest_program(f"workflow/scripts/{rule}.py")


def test_each_job_is_measured_under_its_rule_s_name_and_nothing_reads_that(planned_jobs):
    """Seconds and memory differ from run to run, so nothing reads them, and nothing misses them."""
    for job in planned_jobs:
        if job["script"]:
            assert re.fullmatch(rf"results/benchmarks/{job['rule']}(/.*)?\.tsv", job["benchmark"])
    assert not [
        file for job in planned_jobs for file in job["input"] if file.startswith("results/benchmarks")
    ]


NAME = re.compile(r"snakemake\.(input|output|params)\.(\w+)")


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.stem)
def test_a_script_takes_what_its_rule_names(planned_jobs, script):
    """Everything that it names but the digest of the code, and nothing else."""
    selected = set(NAME.findall(script.read_text()))
    jobs = [job for job in planned_jobs if job["rule"] == script.stem]
    assert jobs
    for job in jobs:
        named = {(kind, name) for kind, names in job["names"].items() for name in names}
        named -= {("params", "code")}
        if script.stem == "manifest":  # which takes its input by the rules that made it
            named = {(kind, name) for kind, name in named if kind != "input"} | {("input", "items")}
        if script.stem == "documents":
            assert job["unnamed"]
        assert selected == named


def test_no_absolute_path_in_the_workflow():
    for file in [ROOT / "Snakefile", *WORKFLOW.rglob("*.smk"), *WORKFLOW.rglob("*.yaml")]:
        assert not re.search(r"""(^|[\s"'])(/[a-z]\w*/|~/)""", file.read_text()), file


def test_an_edited_document_is_filled_anew(planned_jobs):
    """It is an output, and so newer than what it is made from; but its rule is given its digest."""
    (job,) = select_rules(planned_jobs, ["documents"])
    assert job["unnamed"] == [[marks.digest_prose(ROOT / name) for name in STUDY["documents"]]]
