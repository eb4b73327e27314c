"""Help, its examples, and completion in a shell."""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import ROOT
from typed import run_in_python

from unilateral.cli.application import application
from unilateral.errors import suggest_name
from unilateral.solvers.stop import ALGORITHMS
from unilateral.solvers.uzawa_steps import STEP_METHODS

SCRIPT = Path(sys.executable).with_name("unilateral")


@pytest.mark.usefixtures("shared_cases")
@pytest.mark.parametrize("name", ["", *sorted({*application.commands} - {"claims"})])
def test_the_examples_of_help_work_as_typed(run, tmp_path, monkeypatch, name):
    """One after the other, in an empty folder. Those of `claims` are run where the results are."""
    monkeypatch.chdir(tmp_path)
    code, out, err = run(*name.split(), "--help")
    assert (code, err) == (0, "")
    examples = re.findall(r"^    (unilateral .*)$", out.split("\n  Examples:\n")[1], re.MULTILINE)
    assert examples
    for line in examples:
        code, out, err = run(*shlex.split(line)[1:])
        assert (code, err) == (0, "")
        assert out


def test_where_the_study_is_not_installed_its_command_says_so_and_is_not_listed(run):
    """None in the place of a module makes Python take it for missing."""
    assert "\n  claims " in run("--help")[1]
    without = "import sys; sys.modules['study'] = None; from unilateral.cli import main; sys.exit(main({}))"
    code, _, err = run_in_python(without.format(["claims", "4.12"]))
    assert (code, "claims belongs to the study, which 'make' installs" in err) == (2, True)
    code, out, _ = run_in_python(without.format(["--help"]))
    assert (code, "claims" in out) == (0, False)


@pytest.mark.parametrize("name", ["study.py", "study/__init__.py"])
def test_a_study_of_the_user_is_neither_imported_nor_taken_for_this_project_s(tmp_path, name):
    """`python -m` looks in the present folder first."""
    (tmp_path / name).parent.mkdir(exist_ok=True)
    (tmp_path / name).write_text("raise RuntimeError('imported')\n")
    for words, code, message in ((["--help"], 0, ""), (["claims"], 2, "claims belongs to the study")):
        command = [sys.executable, "-m", "unilateral", *words]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, encoding="utf-8", timeout=60)
        assert (done.returncode, message in done.stderr) == (code, True), done.stderr


def test_all_algorithms_can_be_named():
    """Those that iterate by steps are declared beside their steps."""
    assert set(STEP_METHODS) < set(ALGORITHMS)


def test_nothing_is_offered_for_what_is_like_nothing():
    """Control."""
    assert suggest_name("xyz", application.commands) == ""


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("s",), "score solve"),
        (("solve", "nat"), "natural"),
        (("solve", "natural", "--alg"), "--algorithm"),
        (("solve", "natural", "--algorithm", "n"), "nesterov newton"),
        (("solve", "natural", "--polygon", "l"), "lshape"),
        (("solve", "own"), ""),
    ],
)
def test_bash_completes_names_and_leaves_files_to_itself(tmp_path, words, expected):
    """In a real bash, as docs/command-line.md says; files are left to bash itself where no name fits."""
    text = (ROOT / "docs/command-line.md").read_text()
    (switch_on,) = re.findall(r"^(eval .*=bash_source .*)$", text, re.MULTILINE)
    typed = f"COMP_WORDS=({shlex.join(['unilateral', *words])}); COMP_CWORD={len(words)}"
    script = f"{switch_on}\n{typed}\n_unilateral_completion unilateral 2> files\necho ${{COMPREPLY[@]}}"
    path = f"{SCRIPT.parent}{os.pathsep}{os.environ['PATH']}"
    done = subprocess.run(
        ["bash", "-c", script], capture_output=True, text=True, cwd=tmp_path, env={**os.environ, "PATH": path}
    )
    assert (done.stdout.strip(), done.stderr) == (expected, "")
    takes_files = len(words) == 2 or "--polygon" in words
    assert ("compopt" in (tmp_path / "files").read_text()) == takes_files


@pytest.mark.parametrize("arguments", [("--help",), ("solve", "natural", "--h", "1"), ("cases", "--nothing")])
def test_there_are_no_colours_on_a_terminal(arguments):
    """Nor would NO_COLOR change anything: the bytes are the same with it; see no-color.org."""
    printed = []
    for environment in ({}, {"NO_COLOR": "1"}):
        leader, terminal = os.openpty()
        environment = {**os.environ, "TERM": "xterm-256color", **environment}
        subprocess.run([SCRIPT, *arguments], stdout=terminal, stderr=terminal, env=environment, timeout=60)
        printed.append(os.read(leader, 100_000))
        os.close(terminal)
        os.close(leader)
    assert printed[0] == printed[1]
    assert b"\033" not in printed[0]
    assert b"nilateral" in printed[0]
