"""The profile workflow/profiles/slurm on a Slurm of one node, which is started here and stopped.

Where there is no Slurm these tests are skipped, and say so.
"""

import re
import subprocess
import sys

import pytest
from conftest import copy_project
from one_node import missing, one_node

pytestmark = [pytest.mark.nightly, pytest.mark.skipif(bool(missing()), reason=missing())]
PROFILE = ("--workflow-profile", "workflow/profiles/slurm", "--slurm-init-seconds-before-status-checks", "2")
TARGET = "results/quick/dual_norm.nc"
SCRIPT = "workflow/scripts/job.py"
CALL = "            getattr("


@pytest.fixture(scope="module")
def node():
    """The environment of the node, for this file's tests."""
    with one_node() as environment:
        yield environment


def snakemake(project, environment, *arguments):
    """The exit code, and all that is said."""
    command = [sys.executable, "-m", "snakemake", *arguments]
    done = subprocess.run(command, cwd=project, env=environment, capture_output=True, text=True, timeout=600)
    return done.returncode, done.stdout + done.stderr


def spoilt(tmp_path, line):
    """A copy of the project whose jobs begin with that line."""
    project = copy_project(tmp_path)
    script = project / SCRIPT
    text = script.read_text()
    assert text.count(CALL) == 1
    script.write_text(text.replace(CALL, f"            {line}\n{CALL}"))
    return project


def jobs(environment, expected=()):
    """State, memory and comment of the jobs of the node beyond those known, in their order."""
    command = ["squeue", "--states=all", "--noheader", "--sort=i", "--format=%i|%T|%m"]
    stdout = subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout
    rows = [tuple(line.split("|")) for line in stdout.splitlines()]
    return [row for row in rows if row not in expected]


def test_the_cluster_makes_the_tables_of_a_local_run_byte_for_byte(node, tmp_path_factory):
    """The expected bytes are those of the other executor. Control: timings.nc has the seconds and differs."""
    local = copy_project(tmp_path_factory.mktemp("local"))
    remote = copy_project(tmp_path_factory.mktemp("remote"))
    runs = [snakemake(local, node, "-c1", "quick"), snakemake(remote, node, *PROFILE, "quick")]
    assert [code for code, _ in runs] == [0, 0], runs
    assert "submitted with SLURM jobid" in runs[1][1]
    tables = {path.name: path.read_bytes() for path in (local / "results/quick").iterdir()}
    files = {path.name: path.read_bytes() for path in (remote / "results/quick").iterdir()}
    assert tables.keys() == files.keys()
    assert {name for name in tables if tables[name] != files[name]} == {"timings.nc"}


def test_the_whole_study_can_be_planned_with_the_profiles_groups(node, tmp_path):
    """No group waits for a job that waits for that group. Control: with the ledger in it, one does."""
    project = copy_project(tmp_path)
    code, output = snakemake(project, node, *PROFILE, "-n")
    assert code == 0, output
    assert set(re.findall(r"Group job (\w+)", output)) == {"judging", "figures", "telling"}
    rules = ("claims", "document_numbers", "documents", "typeset")
    waiting = ["--groups", *[f"{rule}=telling" for rule in rules]]
    code, output = snakemake(project, node, *PROFILE, *waiting, "-n")
    assert code == 1
    assert "Error in group telling" in output


def test_a_job_that_fails_ends_snakemake_with_the_jobs_log(node, tmp_path):
    project = spoilt(tmp_path, 'raise ValueError("spoilt on purpose")')
    code, output = snakemake(project, node, *PROFILE, "--retries", "0", TARGET)
    assert code == 1
    assert "unilateral: ValueError: spoilt on purpose" in output
    assert not (project / TARGET).exists()


def test_a_job_that_takes_more_memory_than_it_asked_for_is_restarted_with_more(node, tmp_path):
    """2 GB more than it takes: beyond the first request, within the second, which is twice as large.

    Control: without retries the job stays failed, which the test above shows of any failure.
    """
    project = spoilt(tmp_path, 'import time; held = b"x" * 2_000_000_000; time.sleep(5); del held')
    before = jobs(node)
    code, output = snakemake(project, node, *PROFILE, TARGET)
    assert code == 0, output
    assert "Trying to restart job" in output
    (_, first, little), (_, second, extra) = jobs(node, before)
    assert (first, second) == ("FAILED", "COMPLETED")
    assert int(extra.removesuffix("M")) == 2 * int(little.removesuffix("M"))
