"""The examples of docs/adding.md: all of them are added to a copy of the project, and planned, not run.

Control: in test_workflow.py and test_configuration.py what is named and not added, too, is refused.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

from conftest import ROOT, copy_project
from documents import blocks

CASE = next(block.text for block in blocks("manufactured/README.md") if block.kind == "yaml")
POLYGON, RATES, SCENE, SURVEY, FIGURE, CLAIM, AXIS = (block.text for block in blocks("docs/adding.md"))
KIND = """

def calm(values: Array, h: float, H: float, budget: Budget) -> Axis:
    return nothing(values, h, H, budget)
"""
STABILITY = "src/unilateral/study/experiments/stability"
PLACES = [
    ("src/unilateral/geometry/polygons.yaml", "", POLYGON),
    ("manufactured/my_case.yaml", "", CASE),
    ("workflow/config/rates.yaml", "  cases:\n", RATES),
    ("workflow/config/study.yaml", "\nscenes:\n", SCENE),
    ("workflow/config/study.yaml", "\nsurveys:\n", SURVEY),
    (f"{STABILITY}/claims.yaml", "parameters: { scenes: [betasquare", ", mysurvey"),
    (f"{STABILITY}/my_figure_figure.py", "", (ROOT / STABILITY / "multiplier_figure.py").read_text()),
    ("workflow/config/figures.yaml", "figures:\n", FIGURE),
    (f"{STABILITY}/claims.yaml", "", "\n" + CLAIM),
    ("src/unilateral/study/ledger/sections.yaml", "stability: [", '"3.1d", '),
    ("src/unilateral/study/experiments/extremes/contact.py", "", KIND),
    ("workflow/config/extremes.yaml", "  axes:\n", AXIS),
]
"""What is added to a file, and behind which text or, without one, at its end.

A figure has its example in tests/study/pages.py, too.
"""


def run(folder: Path, *arguments: str) -> str:
    """What a program says that uses the library in that folder."""
    command, environment = [sys.executable, *arguments], {**os.environ, "PYTHONPATH": str(folder / "src")}
    found = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=60)
    assert found.returncode == 0, found.stderr
    return found.stdout + found.stderr


def test_what_is_added_is_planned_and_needs_no_other_change(tmp_path: Path) -> None:
    project = copy_project(tmp_path)
    (project / "src/unilateral/manufactured").symlink_to(project / "manufactured")
    for name, marker, text in PLACES:
        file = project / name
        old = file.read_text(encoding="utf-8") if file.exists() else ""
        assert old.count(marker) == 1 or not marker, name
        at = old.index(marker) + len(marker) if marker else len(old)
        file.write_text(old[:at] + text + old[at:], encoding="utf-8")
    targets = ["results/myscene/rates.nc", "figures/my_figure.svg"]
    table = run(project, "-m", "snakemake", "-n", "-c1", *targets).partition("Job stats:")[2]
    jobs = {"dual_norm": 1, "solve": 1, "rates": 1, "surveys": 1, "figure": 1, "total": 5}
    assert {rule: int(count) for rule, count in re.findall(r"^(\w+) +(\d+)$", table, re.MULTILINE)} == jobs
    code = "from unilateral.study.ledger.claims import find; "
    code += "from unilateral.study.experiments.extremes.measure import KINDS; "
    code += "print(find('3.1d').reads, KINDS['calm'].__module__)"
    assert run(project, "-c", code) == "('square/infsup',) unilateral.study.experiments.extremes.contact\n"
