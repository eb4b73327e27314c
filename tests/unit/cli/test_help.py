"""Help, its examples, what is offered for a name that is misspelt, and completion in a shell."""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import click
import pytest
from conftest import ROOT

from unilateral.cli import solve_options
from unilateral.cli.application import COMMANDS, application
from unilateral.cli.command import CODES
from unilateral.errors import meant
from unilateral.solvers.stop import ALGORITHMS
from unilateral.solvers.uzawa_steps import STEPS

SCRIPT = Path(sys.executable).with_name("unilateral")
EVERY = ["", *COMMANDS]


def command_of(name):
    return application.get_command(click.Context(application), name) if name else application


@pytest.mark.parametrize("name", EVERY)
def test_help_ends_with_examples_and_exit_codes(run, name):
    """Each code with its meaning; a command without one of them would not say what its caller gets."""
    code, out, err = run(*name.split(), "--help")
    assert (code, err) == (0, "")
    examples, codes = out.split("\nExamples:\n")[1].split("\nExit codes:\n")
    assert re.fullmatch(r"(  unilateral .*\n)+", examples)
    listed = dict(line.split(maxsplit=1) for line in codes.splitlines())
    assert listed == {str(code): CODES[code] for code in command_of(name).codes}
    assert {0, 2, 4, 130, 143} <= set(command_of(name).codes)


@pytest.mark.parametrize("name", [name for name in EVERY if name != "claims"])
def test_the_examples_of_help_work_as_typed(run, tmp_path, monkeypatch, name):
    """One after the other, in an empty folder. Those of `claims` are run where the results are."""
    monkeypatch.chdir(tmp_path)
    for line in command_of(name).examples:
        program, *arguments = shlex.split(line)
        code, out, err = run(*arguments)
        assert (program, code, err) == ("unilateral", 0, "")
        assert out


def test_only_what_can_fail_so_has_the_codes_of_claims_and_of_solvers():
    """1 is something judged that does not hold, 3 a solve that misses its stop or has no bound."""
    assert [name for name in COMMANDS if 1 in command_of(name).codes] == ["score", "claims"]
    assert [name for name in COMMANDS if 3 in command_of(name).codes] == ["solve", "certify"]


def test_where_the_study_is_not_installed_its_command_says_so_and_is_not_listed(run, refused, monkeypatch):
    """None in the place of a module makes Python take it for missing."""
    assert "\n  claims " in run("--help")[1]
    for name in [name for name in sys.modules if name.partition(".")[0] == "study"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "study", None)
    assert "claims belongs to the study, which 'make' installs" in refused("claims", "4.12")
    assert "\n  claims " not in run("--help")[1]


def test_the_placeholders_of_an_option_are_its_own(run):
    """--h and --H are sizes of two things."""
    out = run("solve", "--help")[1]
    assert re.search(r"--h EDGE .*\n +--H CELL ", out)


def test_all_algorithms_can_be_named():
    """Those that iterate by steps are declared beside their steps."""
    assert set(STEPS) < set(ALGORITHMS)
    helps = [each.help for each in command_of("solve").params[1:]]
    assert f"default {solve_options.Stop.max_steps}" in str(helps)


def test_nothing_is_offered_for_what_is_like_nothing():
    """Control."""
    assert meant("xyz", COMMANDS) == ""


@pytest.mark.parametrize(
    ("words", "found"),
    [
        (("s",), "solve score"),
        (("solve", "nat"), "natural"),
        (("solve", "natural", "--alg"), "--algorithm"),
        (("solve", "natural", "--algorithm", "n"), "nesterov newton"),
        (("solve", "natural", "--polygon", "l"), "lshape"),
        (("solve", "own"), ""),
    ],
)
def test_bash_completes(tmp_path, words, found):
    """In a real bash, as docs/command-line.md says; files are left to bash itself where no name fits."""
    text = (ROOT / "docs/command-line.md").read_text()
    (switch_on,) = re.findall(r"^(eval .*=bash_source .*)$", text, re.MULTILINE)
    typed = f"COMP_WORDS=({shlex.join(['unilateral', *words])}); COMP_CWORD={len(words)}"
    script = f"{switch_on}\n{typed}\n_unilateral_completion unilateral 2> files\necho ${{COMPREPLY[@]}}"
    path = f"{SCRIPT.parent}{os.pathsep}{os.environ['PATH']}"
    done = subprocess.run(
        ["bash", "-c", script], capture_output=True, text=True, cwd=tmp_path, env={**os.environ, "PATH": path}
    )
    assert (done.stdout.strip(), done.stderr) == (found, "")
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
