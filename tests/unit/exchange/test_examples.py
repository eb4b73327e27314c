"""The drivers in examples/ export, solve elsewhere and are scored, by the commands that they name."""

import json
import re
import subprocess
import sys

import pytest
from conftest import ROOT, discrete, load

from unilateral.cli import main
from unilateral.exchange.faults import residual
from unilateral.exchange.read import exported, foreign

DRIVER = ROOT / "examples/score_scikit_fem.py"
MOST_LINES = 80


@pytest.fixture(scope="module")
def told(tmp_path_factory):
    """What `score --json` says after the commands in the driver's first lines."""
    folder = tmp_path_factory.mktemp("driver")
    (folder / "examples").symlink_to(ROOT / "examples")
    export, solve, score = re.findall(r"^    (unilateral .*|python .*)$", DRIVER.read_text(), re.MULTILINE)
    page = (ROOT / "docs/own-solver.md").read_text()
    assert all(line in page for line in (export, solve, score))
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        assert main(export.split()[1:]) == 0
        subprocess.run([sys.executable, *solve.split()[1:]], check=True, timeout=120)
        solutions = sorted(str(file) for file in folder.glob(score.split()[-1]))
    return folder / "natural", solutions


def test_the_driver_is_short_and_on_its_own():
    text = DRIVER.read_text()
    assert len(text.splitlines()) < MOST_LINES
    assert not re.search(r"^\s*(from|import) unilateral", text, re.MULTILINE)


def test_the_driver_reaches_the_proved_rates(told, capsys):
    """(4.11)-(4.13); no function of V_h is nearer to u in H1 than its Ritz projection.

    A driver that solved another problem would be told a fault, or have no rate.
    """
    folder, solutions = told
    assert main(["score", str(folder), *solutions, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["verdict"] == "reaches the proved rates"
    assert [one["level"] for one in found["solutions"]] == ["level_0", "level_1", "level_2"]
    for one, n in zip(found["solutions"], (8, 16, 32), strict=True):
        assert one["faults"] == []
        best = discrete("natural", n, n // 2).exact.ritz.ritz_error
        assert best * (1 - 1e-9) <= one["errors"]["h1"]
        assert "mass matrix" in one["multiplier"]


def test_the_driver_has_the_load_of_the_exported_quadrature(told):
    """Its equation holds inside up to rounding. Corners of triangles in another order would miss by 1e-3."""
    folder, solutions = told
    _, levels = exported(folder)
    for file, n in zip(solutions, (8, 16, 32), strict=True):
        of = residual(load("natural"), discrete("natural", n, n // 2), foreign(levels, file).u)
        assert of.inside <= 1e-10 * of.discrete.exact.ritz.u_norm
