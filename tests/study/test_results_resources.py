"""The memory that jobs took, as their logs say, against what they would ask a cluster for."""

import copy
import re

import pytest
from conftest import RESULTS, ROOT

from unilateral.study import config as configuration
from unilateral.study import resources

FILES = ("study", "rates", "worst_infsup", "extremes", "figures", "resources")
PEAK = re.compile(r"^done in .* s, with at most (\d+) MB$", re.MULTILINE)
WILDCARD = {
    "cost_runs": "job",
    "figure": "figure",
    "deep_level": "level",
    "typeset": "paper",
}
NOT_IN_ALL = {"deep_level", "deep_levels"}


@pytest.fixture(scope="module")
def study():
    files = [str(ROOT / f"workflow/config/{name}.yaml") for name in FILES]
    given, sources = configuration.read(files)
    configuration.check(given, sources, str(ROOT / "workflow/schemas/study.schema.yaml"))
    return given


def peaks(study):
    """Rule, wildcards and peak memory of the jobs that the configuration still has."""
    for log in sorted((RESULTS / "logs").rglob("*.log")):
        rule, *values = log.relative_to(RESULTS / "logs").with_suffix("").parts
        name = WILDCARD.get(rule, "scene")
        known = study["scenes"] if name == "scene" else values
        found = PEAK.search(log.read_text())
        if rule in study["resources"]["rules"] and found and len(values) <= 1 and set(values) <= set(known):
            yield rule, dict.fromkeys([name], *values) if values else {}, int(found[1])


def over(study):
    """The jobs that would be ended on a cluster."""
    own = study["resources"]["snakemake"]["mb"]
    return [job for job in peaks(study) if own + job[2] > resources.mem_mb(study, *job[:2])]


def test_every_job_stayed_below_the_memory_that_it_asks_for(study):
    assert {rule for rule, *_ in peaks(study)} >= set(study["resources"]["rules"]) - NOT_IN_ALL
    assert over(study) == []


def test_jobs_that_ask_for_too_little_are_found(study):
    """Control: with half of the margin on each measured job every large job is over."""
    less = copy.deepcopy(study)
    less["resources"]["margin"]["mb"] = 0.5
    assert {"solve", "dual_norm", "surveys"} <= {rule for rule, *_ in over(less)}
