"""The drivers in examples/ export, solve elsewhere and are scored, by the commands that they name.

Each runs where benchmarks.yaml, or a variable, names a Python with its package; else its test is skipped,
with the sentence that the driver itself says.
"""

import json
import re
import shutil
import subprocess
import sys
from contextlib import redirect_stdout
from io import StringIO

import pytest
from conftest import ROOT, discrete

from benchmarks import plan
from unilateral.cli import main
from unilateral.exchange.equation_residual import Residual
from unilateral.exchange.exported_folder import read_exported_folder, read_foreign_solution

PLAN = plan.read(plan.FOLDER / "benchmarks.yaml")
DRIVERS = PLAN["scores"]["drivers"]
MOST_LINES = 80
MISSING = 5
PYTHON = {solver: shutil.which(plan.interpreter(PLAN, solver)) or sys.executable for solver in DRIVERS}


def text(solver):
    return (ROOT / DRIVERS[solver]).read_text()


@pytest.fixture(scope="module", params=DRIVERS)
def driver_run(request, tmp_path_factory):
    """The exported folder and what `score --json` says, after the commands in the driver's first lines."""
    solver = request.param
    folder = tmp_path_factory.mktemp("driver")
    (folder / "examples").symlink_to(ROOT / "examples")
    head = text(solver).split('"""')[1].replace("\\\n", " ")
    export, solve, score = re.findall(r"^    (unilateral .*|python .*)$", head, re.MULTILINE)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        assert main(export.split()[1:]) == 0
        command = [PYTHON[solver], *solve.split()[1:]]
        done = subprocess.run(command, capture_output=True, text=True, timeout=300)
        if done.returncode == MISSING:
            pytest.skip(done.stderr.strip())
        assert done.returncode == 0, done.stderr
        shell = f"printf '%s\\n' {score.partition(' ')[2]}"
        arguments = subprocess.run(["sh", "-c", shell], capture_output=True, text=True, check=True).stdout
        words = arguments.split()
        with redirect_stdout(StringIO()) as out:
            assert main([*words, "--json"]) == 0
    return folder, words[1:], json.loads(out.getvalue())


@pytest.mark.parametrize("solver", DRIVERS)
def test_a_driver_is_short_and_on_its_own(solver):
    assert len(text(solver).splitlines()) < MOST_LINES
    assert not re.search(r"^\s*(from|import) unilateral", text(solver), re.MULTILINE)
    assert f"examples/{DRIVERS[solver].partition('/')[2]}" in (ROOT / "docs/own-solver.md").read_text()


@pytest.mark.parametrize("solver", [solver for solver in DRIVERS if solver != "skfem"])
def test_a_driver_says_in_a_sentence_what_is_missing(solver, tmp_path):
    """Where its package cannot be imported: modules of that name that are none come first."""
    for name in PLAN["solvers"][solver]["imports"]:
        (tmp_path / f"{name}.py").write_text("raise ImportError")
    done = subprocess.run(
        [sys.executable, str(ROOT / DRIVERS[solver]), "natural"],
        capture_output=True,
        text=True,
        env={"PYTHONPATH": str(tmp_path)},
        timeout=60,
    )
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (MISSING, "", 1)
    assert " is missing; " in done.stderr


def test_a_driver_reaches_the_proved_rates(driver_run):
    """(4.11)-(4.13); no function of V_h is nearer to u in H1 than its Ritz projection.

    A driver that solved another problem would be told a fault, or have no rate.
    """
    _, _, computed = driver_run
    assert computed["verdict"] == "reaches the proved rates"
    assert [solution["level"] for solution in computed["solutions"]] == ["level_0", "level_1", "level_2"]
    for record, n in zip(computed["solutions"], (8, 16, 32), strict=True):
        assert record["faults"] == []
        best = discrete("natural", n, n // 2).exact.ritz.ritz_error
        assert best * (1 - 1e-9) <= record["errors"]["h1"]
        assert record["errors"]["hm12_upper"] > 0


def test_a_driver_has_the_load_of_the_exported_quadrature(driver_run):
    """Its equation holds inside up to rounding. Corners of triangles in another order would miss by 1e-3."""
    folder, words, _ = driver_run
    _, levels = read_exported_folder(folder / "natural")
    for file, n in zip(words[1:4], (8, 16, 32), strict=True):
        problem = discrete("natural", n, n // 2)
        residual = Residual(problem, read_foreign_solution(levels, str(folder / file)).u, problem.load)
        assert residual.interior_norm <= 1e-10 * residual.discrete.exact.ritz.u_norm
