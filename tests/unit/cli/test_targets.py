"""Places that cannot be written: commands that write tell it in one sentence, with a code for each fault."""

import errno
import os
from pathlib import Path

import pytest
from typed import PROBLEM

from unilateral.cli import main

AT = ["--h", "1/4", "--H", "1/2"]
WRITERS = {
    "solve -o": ["solve", PROBLEM, *AT, "-o", "new.csv"],
    "solve --out": ["solve", PROBLEM, *AT, "--out", "new"],
    "solve --certificate": ["solve", PROBLEM, *AT, "--certificate", "new.json.gz"],
    "init": ["init", "new.yaml"],
    "check": ["check", PROBLEM, "-o", "new.svg"],
    "export": ["export", "natural", *AT, "--out", "new"],
    "score": ["score", "exported", "solution.vtu", "--html", "new.html"],
}
"""Every command that writes, with what it is to write in the current folder."""


@pytest.fixture(scope="module")
def judged_folder(tmp_path_factory):
    """A folder with an exported case and a solution of it."""
    folder = tmp_path_factory.mktemp("judged")
    assert main(["export", "natural", *AT, "--out", str(folder / "exported")]) == 0
    assert main(["solve", "natural", *AT, "-o", str(folder / "solution.vtu")]) == 0
    return folder


@pytest.fixture
def run_writer(run, judged_folder, monkeypatch):
    """Runs one of WRITERS in that folder, to which it must add nothing."""

    def typing(name):
        monkeypatch.chdir(judged_folder)
        before = sorted(judged_folder.iterdir())
        code, _, err = run(*WRITERS[name])
        assert sorted(judged_folder.iterdir()) == before
        return code, err

    return typing


def deny(monkeypatch, reason):
    """No folder can be made, for that reason. Permissions themselves do not bind root, who may run this."""

    def refuse(path, *_, **__):
        raise OSError(reason, os.strerror(reason), str(path))

    monkeypatch.setattr(Path, "mkdir", refuse)


@pytest.mark.parametrize("name", WRITERS)
@pytest.mark.parametrize("reason", [errno.EACCES, errno.EROFS])
def test_a_place_that_must_not_be_written_is_code_2(run_writer, monkeypatch, name, reason):
    deny(monkeypatch, reason)
    code, err = run_writer(name)
    assert (code, err.count("\n")) == (2, 1)
    assert err.startswith("unilateral: new")
    assert err.endswith(f" cannot be written: {os.strerror(reason)}\n")


@pytest.mark.parametrize("name", WRITERS)
def test_a_full_disk_is_code_4(run_writer, monkeypatch, name):
    """Control."""
    reason = errno.ENOSPC
    deny(monkeypatch, reason)
    code, err = run_writer(name)
    assert (code, err.count("\n")) == (4, 1)
    assert err.endswith(f" cannot be written: {os.strerror(reason)}\n")


@pytest.mark.parametrize("name", sorted(set(WRITERS) - {"solve --out"}))
def test_a_folder_in_which_nothing_may_be_written_is_code_2(run_writer, monkeypatch, name):
    """As `os.access` tells it before any work; a folder of --out need not be there, and is made."""
    monkeypatch.setattr(os, "access", lambda *_: False)
    code, err = run_writer(name)
    assert (code, err.count("\n")) == (2, 1)
    assert " cannot be written: nothing may be written in ." in err


@pytest.mark.parametrize("name", WRITERS)
def test_control_without_a_fault_all_of_them_write(run, judged_folder, monkeypatch, name, tmp_path):
    monkeypatch.chdir(judged_folder)
    *arguments, target = WRITERS[name]
    assert run(*arguments, tmp_path / target)[0] in (0, 1)
    assert (tmp_path / target).exists()
