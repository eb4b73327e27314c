"""What Linux has and other systems have not is missed by nothing; on these themselves nothing was tried.

Windows has no `resource`, no METIS, no SIGPIPE, no timer for signals, no `os.sysconf`; macOS has no /proc.
What there is in place of these is played here. Texts are UTF-8 whatever a system takes for its own.
"""

import json
import os
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.sparse as sp
from conftest import ROOT
from nested import assemble_by_elements

from unilateral.fem import linear_systems
from unilateral.geometry.polygon import find_polygon
from unilateral.geometry.structured import make_structured_mesh
from unilateral.system import memory

WITHOUT = """\
import ctypes, os, pathlib, signal, sys, types

for name in ("fcntl", "grp", "pwd", "pymetis", "resource", "termios"):
    sys.modules[name] = None
for name in ("SIGALRM", "SIGHUP", "SIGKILL", "SIGPIPE", "SIGUSR1", "setitimer", "getitimer", "ITIMER_REAL"):
    delattr(signal, name)
for name in ("sysconf", "getuid", "geteuid", "fork", "getpgid", "killpg"):
    delattr(os, name)
process = types.SimpleNamespace(memory_info=lambda: types.SimpleNamespace(peak_wset=99 * 2**20))
machine = types.SimpleNamespace(available=8 * 2**30)
sys.modules["psutil"] = types.SimpleNamespace(Process=lambda: process, virtual_memory=lambda: machine)
library = ctypes.CDLL
ctypes.CDLL = lambda name, *rest, **more: library(name or {}, *rest, **more)  # TypeError, as on Windows
opened = pathlib.Path.open
def no_proc(path, *rest, **more):
    if path.parts[:2] in (("/", "proc"), ("/", "sys")):
        raise FileNotFoundError(path)
    return opened(path, *rest, **more)
pathlib.Path.open = no_proc
from unilateral.__main__ import main
sys.exit(main())
"""
"""The command `unilateral` where all that is missing."""
OF_THE_RUN = {"seconds", "peak_mb", "versions", "iterations", "algebraic_bound"}
"""What the machine, and the order in which unknowns are eliminated, have a say in."""


def run_command(*arguments, **environment):
    """What a command prints; it has to succeed without a word on standard error."""
    done = subprocess.run(
        [sys.executable, *arguments], capture_output=True, env={**os.environ, **environment}, timeout=60
    )
    assert (done.returncode, done.stderr) == (0, b"")
    return done.stdout


@pytest.mark.parametrize("how", [("--accuracy", "0.1"), ("--h", "1/16", "--H", "1/8")], ids=" ".join)
def test_a_solution_is_the_same_without_what_only_linux_has(how, run):
    """By levels, and by elimination in another order: the same numbers up to rounding."""
    task = ["solve", str(ROOT / "examples/cog.yaml"), *how, "--json"]
    document = json.loads(run(*task)[1])
    there = json.loads(run_command("-c", WITHOUT, *task))
    assert there["peak_mb"] == 99
    for name in set(document) - OF_THE_RUN - {"levels", "contact", "forces"}:
        is_real = isinstance(document[name], float)
        assert there[name] == (pytest.approx(document[name], rel=1e-6) if is_real else document[name])
    here_whole = document["forces"]["boundary"]
    there_whole = there["forces"]["boundary"]
    assert there_whole.pop("known") == here_whole.pop("known") == "both"
    assert there_whole == pytest.approx(here_whole, rel=1e-6)


WRITES = """\
import pathlib, warnings
from unilateral.cli import main

file, solve = pathlib.Path("own.yaml"), ["solve", "own.yaml", "--h", "100", "--H", "200", "-o"]
assert main(["init", "own.yaml"]) == 0
file.write_bytes(file.read_bytes() + "# \\u03bb \\u2202\\n".encode())
assert main(["check", "own.yaml"]) == 0
assert main([*solve, "own.csv"]) == 0
warnings.simplefilter("ignore", EncodingWarning)
assert main([*solve, "own.vtu"]) == 0
"""
"""Commands that write files; meshio opens its own in the locale's encoding."""


def test_files_are_the_same_where_the_locale_has_ascii_only(tmp_path, monkeypatch):
    """And nothing is opened in the locale's encoding, of which Python warns if it is asked to; libraries that
    write other files than .csv do so.
    """
    strict = ["-X", "warn_default_encoding", "-W", "error::EncodingWarning", "-c", WRITES]
    written = []
    ascii_only = {"PYTHONUTF8": "0", "LC_ALL": "C", "PYTHONCOERCECLOCALE": "0"}
    for name, environment in (("utf-8", {}), ("ascii", ascii_only)):
        folder = tmp_path / name
        folder.mkdir()
        monkeypatch.chdir(folder)
        run_command(*strict, **environment)
        written.append([(folder / f"own.{ending}").read_bytes() for ending in ("yaml", "csv", "vtu")])
    assert written[0] == written[1]
    assert b"\r" not in b"".join(written[0])


def test_memory_is_that_of_windows_where_there_is_no_getrusage(monkeypatch):
    """Peak and free memory as psutil tells them; a container's limit is not known there."""
    process = SimpleNamespace(memory_info=lambda: SimpleNamespace(peak_wset=300 * 2**20))
    machine = SimpleNamespace(available=500 * 2**20)
    system = SimpleNamespace(virtual_memory=lambda: machine, Process=lambda: process)
    monkeypatch.setattr(memory, "psutil", system)
    monkeypatch.setattr(memory, "CGROUP", memory.CGROUP / "none")
    assert (memory.peak_mb(), memory.available_mb()) == (300, 500)


def test_the_boundary_is_eliminated_last_without_metis(monkeypatch):
    """The Schur complement in the factors is the one by dense algebra."""
    monkeypatch.setattr(linear_systems, "pymetis", None)
    mesh = make_structured_mesh(find_polygon("lshape"), 1 / 8)
    A = sp.csr_array(assemble_by_elements(mesh))
    order = linear_systems.elimination_order(A, mesh.boundary)
    assert sorted(order) == list(range(mesh.n_nodes))
    R = linear_systems.schur_factor(linear_systems.factorise(A, order), len(mesh.boundary))
    inner = np.delete(np.arange(mesh.n_nodes), mesh.boundary)
    dense = A.toarray()
    across = dense[np.ix_(inner, mesh.boundary)]
    boundary = dense[np.ix_(mesh.boundary, mesh.boundary)]
    schur = boundary - across.T @ np.linalg.solve(dense[np.ix_(inner, inner)], across)
    np.testing.assert_allclose(R.T @ R, schur, rtol=0, atol=1e-13 * np.abs(schur).max())
