"""What Snakemake does with the rules: what it makes anew, what ends it early, what it objects to."""

import errno
import fcntl
import importlib.util
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections import defaultdict
from pathlib import Path

import pytest
import sentences
from conftest import ROOT, copy_project

from study import tables
from unilateral.errors import StorageError


@pytest.fixture(scope="module")
def tree(tmp_path_factory):
    return copy_project(tmp_path_factory.mktemp("study"))


class Server:
    """Runs of Snakemake, one after the other, in children of one process: see snakemake_server.py."""

    def __init__(self, process):
        self.process = process

    def start(self, folder, *arguments):
        """The number of a process that runs Snakemake in that folder."""
        self.process.stdin.write(json.dumps([str(folder), *arguments]) + "\n")
        self.process.stdin.flush()
        return int(self.process.stdout.readline())

    def end(self):
        """The exit code of the started process, and what it printed on standard output and error."""
        return json.loads(self.process.stdout.readline())

    def run(self, folder, *arguments):
        self.start(folder, *arguments)
        return self.end()


@pytest.fixture(scope="module")
def server():
    command = [sys.executable, str(Path(__file__).with_name("snakemake_server.py"))]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        yield Server(process)
        process.stdin.close()


@pytest.fixture(scope="module")
def dry_run(server, tree):
    return lambda *arguments: server.run(tree, "-n", "-c1", *arguments)


SOLVED = ("mesh.vtu", "solutions.nc", "errors.nc", "infsup.nc", "timings.nc")
RULES = {"dual_norm.nc": "dual_norm", **dict.fromkeys(SOLVED, "solve"), "rates.nc": "rates"}
"""The files of a scene and their rules, in the order in which they are made."""
MISSING = {
    "square": "dual_norm.nc",
    "unstructured": "mesh.vtu",
    "lshape": "solutions.nc",
    "irregular": "errors.nc",
    "cantor": "infsup.nc",
    "corners": "timings.nc",
    "clamped": "rates.nc",
}
"""Scenes, each with the file that is missing there; those of `quick` are all there."""
MESSAGES = {"the dual norm": "dual_norm", "all cases on all levels": "solve", "rates, judged": "rates"}
"""What rules say when they begin, behind the name of the scene."""


def make_results(tree, scene):
    """Files in place of the results of a scene, in their folder."""
    folder = tree / f"results/{scene}"
    folder.mkdir(parents=True)
    for i, name in enumerate(RULES):
        (folder / name).write_text("a result")
        os.utime(folder / name, (time.time() + i, time.time() + i))
    return folder


def jobs_of_scenes(text):
    """The rules of the jobs that a dry run plans, by their scenes."""
    jobs = defaultdict(list)
    for scene, message in re.findall(r"^Job \d+: (\w+): (.*)$", text, re.MULTILINE):
        jobs[scene].append(MESSAGES[message])
    return jobs


@pytest.fixture(scope="module")
def planned_jobs(tree, dry_run):
    """The jobs of scenes where one file each is missing, and of `quick`."""
    for scene, name in MISSING.items():
        (make_results(tree, scene) / name).unlink()
    make_results(tree, "quick")
    files = [f"results/{scene}/{name}" for scene in [*MISSING, "quick"] for name in RULES]
    code, out, err = dry_run(*files, "--rerun-triggers", "mtime")
    shutil.rmtree(tree / "results")
    assert code == 0, out + err
    return jobs_of_scenes(out + err)


def test_what_is_there_is_not_made_anew(planned_jobs):
    """Control. It waits until the process of all runs has imported Snakemake."""
    assert planned_jobs["quick"] == []


@pytest.mark.parametrize("scene", MISSING)
def test_what_is_missing_is_made_anew_with_what_follows_from_it(planned_jobs, scene):
    rules = planned_jobs[scene]
    assert rules.count(RULES[MISSING[scene]]) == 1
    assert rules.count("rates") == 1


DAMAGED = {"square": "dual_norm.nc", "unstructured": "solutions.nc", "lshape": "errors.nc"}


def test_one_command_makes_a_damaged_file_anew(tree, dry_run):
    """The one that messages name."""
    folders = {scene: make_results(tree, scene) for scene in DAMAGED}
    files = [f"results/{scene}/{name}" for scene, name in DAMAGED.items()]
    _, out, err = dry_run("-f", *files, "--rerun-triggers", "mtime")
    assert jobs_of_scenes(out + err) == {scene: [RULES[name]] for scene, name in DAMAGED.items()}
    for scene, name in DAMAGED.items():
        with sentences.raises(StorageError, name):
            tables.load_table(folders[scene] / name)
    shutil.rmtree(tree / "results")


REFUSED = [
    (
        ("study", "levels: 4 }\n    H:", "levels: four }\n    H:"),
        "workflow/config/study.yaml, field scenes.quick.mesh.levels: 'four' is not of type "
        "'integer'; write a whole number such as 3",
    ),
    (
        ("study", "judged: false", "judged: false\n    judged: true"),
        r"workflow/config/study.yaml: 'judged' is given twice, again in line \d+; give it once",
    ),
]


@pytest.mark.parametrize(("change", "message"), REFUSED)
def test_a_bad_configuration_is_refused_in_one_line_before_anything_runs(tree, dry_run, change, message):
    """Also by a dry run, and whatever the target is. What else is refused is in test_configuration.py."""
    name, old, new = change
    file = tree / f"workflow/config/{name}.yaml"
    retained = file.read_text()
    assert retained.count(old) == 1
    file.write_text(retained.replace(old, new))
    code, _, err = dry_run("figures/solution.svg")
    file.write_text(retained)
    assert code == 2
    assert re.fullmatch(f"unilateral: {message}\n", err)


def test_a_parameter_from_the_command_line_is_checked_too(dry_run):
    code, _, err = dry_run("quick", "--config", "stop=4")
    assert code == 2
    assert "field stop: 4 is not of type 'object'; write a mapping" in err


def test_a_failing_job_says_why_and_leaves_nothing_half_written(server, tree):
    """The dual norm that it reads is no table. This takes as long as a job takes to begin.

    Snakemake ends a line of its own when it likes, and so the sentence need not be at the start of one.
    """
    folder = make_results(tree, "quick")
    remaining = set(folder.iterdir()) - {folder / name for name in SOLVED}
    code, out, err = server.run(tree, "-c1", "-f", "results/quick/errors.nc", "--rerun-triggers", "mtime")
    matches = re.findall(r"unilateral: .*dual_norm\.nc is damaged .*\n", out + err)
    assert (code, len(matches)) == (1, 1)
    assert (tree / "results/logs/solve/quick.log").read_text() == matches[0]
    assert set(folder.iterdir()) == remaining
    shutil.rmtree(tree / "results")


ACCEPTED = {"Specify a conda environment or container for each rule."}
"""All rules run in the one environment that holds the locked packages, and Snakemake itself: .venv. A rule of
its own could only repeat it, in a second way to set it up."""


@pytest.fixture
def lints(server):
    """The titles of what Snakemake's linter says of the Snakefile in a folder."""

    def titles(folder):
        _, _, err = server.run(folder, "--lint")
        assert "Lints for" in err, err
        return set(re.findall(r"^    \* (.*):$", err, re.MULTILINE))

    return titles


def test_snakemake_s_linter_has_nothing_else_to_say(lints, tree):
    assert lints(tree) <= ACCEPTED


def test_a_rule_without_a_log_would_be_found(lints, tmp_path):
    """Control."""
    (tmp_path / "Snakefile").write_text("rule made:\n    output: 'x'\n    shell: 'touch x'\n")
    assert lints(tmp_path) - ACCEPTED == {"No log directive defined"}


@pytest.fixture
def resume(tmp_path, monkeypatch):
    """What `make` begins with, in a folder where a killed run left a lock and files half written."""
    spec = importlib.util.spec_from_file_location("resume", ROOT / "workflow/resume.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    monkeypatch.chdir(tmp_path)
    for name in (".snakemake/locks/0.input.lock", "Snakefile", "results/square/errors.nc", ".hidden.tmp"):
        Path(name).parent.mkdir(parents=True, exist_ok=True)
        Path(name).touch()
    for name in ("results/square/errors.nc", "figures/rates.svg", "README.md"):
        leftover = Path(name).with_name(f".{Path(name).name}.0123456789abcdef.tmp")
        leftover.mkdir(parents=True)
        (leftover / "half").touch()
    return module.main


def files():
    return sorted(str(file) for file in Path().rglob("*") if file.is_file())


def test_what_a_killed_run_left_is_removed_and_nothing_else(resume):
    resume()
    assert files() == [".hidden.tmp", "Snakefile", "results/square/errors.nc"]
    assert not list(Path().rglob("*.tmp/"))
    before = files()
    resume()
    assert files() == before


def test_nothing_is_removed_while_another_run_is_alive(resume):
    """It ends in a sentence if that run has Snakemake's lock; a dry run has none, and does not matter."""
    before = files()
    with open("Snakefile") as alive:
        fcntl.flock(alive, fcntl.LOCK_SH)
        with pytest.raises(SystemExit, match="Another run of the study is at work in this folder; wait"):
            resume()
        assert files() == before
        shutil.rmtree(".snakemake/locks")
        resume()
        assert set(files()) == {file for file in before if not file.startswith(".snakemake")}
    resume()
    assert not list(Path().rglob("*.tmp/"))


def test_where_there_are_no_locks_nothing_is_removed(resume, monkeypatch):
    """As on some shared file systems: nobody knows then whether another run lives."""

    def refuse_lock(*_):
        raise OSError(errno.ENOLCK, "No locks available")

    before = files()
    monkeypatch.setattr(fcntl, "flock", refuse_lock)
    resume()
    assert files() == before


def test_of_two_runs_started_together_the_second_one_ends_in_a_sentence(tmp_path):
    """As `make` starts them, before Snakemake has a lock. Control: when the first one has ended."""
    (tmp_path / "Snakefile").touch()
    copied = shutil.copy(ROOT / "workflow/resume.py", tmp_path)
    command = [sys.executable, copied, sys.executable, "-c"]
    work = "print('at work', flush=True); input()"
    first = subprocess.Popen(
        [*command, work], cwd=tmp_path, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert first.stdout.readline() == "at work\n"
    second = subprocess.run([*command, work], cwd=tmp_path, capture_output=True, text=True, timeout=60)
    assert (second.returncode, second.stdout) == (1, "")
    assert re.fullmatch(r"Another run of the study is at work in this folder; .*\.\n", second.stderr)
    first.communicate("\n", timeout=60)
    assert first.returncode == 0
    third = subprocess.run([*command, "print('at work')"], cwd=tmp_path, capture_output=True, text=True)
    assert (third.returncode, third.stdout, third.stderr) == (0, "at work\n", "")


OF_MAKE = ("MAKEFLAGS", "MAKELEVEL", "MFLAGS")
"""What make tells the makes that it starts."""
REFUSED_IN_PATHS = ["it's", "a$b", "par(en)", "sp ace", "co:lon", 'q"q', "a&b", "back\\slash", "br[a]", "b`t"]
"""Folders below which bash, in Snakemake, or PATH fails; a colon parts PATH."""


@pytest.mark.parametrize("name", [*REFUSED_IN_PATHS, "good-1.2_x+y", "schön,a@b%c=d~e"])
def test_make_refuses_folders_below_which_snakemake_fails(tmp_path, name):
    """In one sentence, before anything is done. Control: the last two names are allowed."""
    folder = tmp_path / name / "project"
    folder.mkdir(parents=True)
    shutil.copy(ROOT / "Makefile", folder)
    # without what `make test`, which may run this test, tells a make below it
    environment = {key: value for key, value in os.environ.items() if key not in OF_MAKE}
    done = subprocess.run(
        ["make", "help"], cwd=folder, env=environment, capture_output=True, text=True, timeout=60
    )
    if name in REFUSED_IN_PATHS:
        text = f"in its path; move the project out of '{folder}'.  Stop."
        assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1)
        assert text in done.stderr
    else:
        assert (done.returncode, done.stderr) == (0, "")


def test_a_run_that_is_killed_can_be_taken_up_and_one_that_lives_cannot(server, tree, resume, monkeypatch):
    """A real one, killed as soon as it has its lock."""
    monkeypatch.chdir(tree)
    run = server.start(tree, "-c1", "quick")
    try:
        locks = Path(".snakemake/locks")
        begun = time.monotonic()
        while not (locks.is_dir() and list(locks.iterdir())):
            assert time.monotonic() < begun + 60
            time.sleep(0.05)
        with pytest.raises(SystemExit, match="Another run of the study is at work"):
            resume()
    finally:
        os.killpg(run, signal.SIGKILL)
    assert server.end()[0] == -signal.SIGKILL
    assert list(locks.iterdir())
    resume()
    assert not list(locks.iterdir())
    shutil.rmtree("results", ignore_errors=True)
