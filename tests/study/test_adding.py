"""What CONTRIBUTING.md says of adding: all of it is added to a copy of the project, and planned, not run.

Control: in test_workflow.py and test_configuration.py what is named and not added, too, is refused.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

from conftest import ROOT, copy_project

EXAMPLE = (ROOT / "manufactured/README.md").read_text(encoding="utf-8")
RATE = "{ rate: 1, source: set for a test }"
SCENE = """\
  added:
    polygon: pentagon
    cases: [thirds]
    mesh: { kind: unstructured, h: 1/4, levels: 3 }
    H: [1/2, 1/4, 1/8]
    H_over_h: { min: 2 }
"""
SURVEY = """\
  betaadded:
    label: edges graded by 3, cells not
    kind: local
    polygon: square
    partitions: [{ H: 1/4 }]
    mesh: { kind: graded, grading: 3 }
    edges_per_cell: [2, 3]
"""
FIGURE = """\
  again:
    module: again
    shows: multipliers of another survey
    reads: { survey: results/betaadded/infsup.nc }
    parameters: { h_over_H: [1/2, 1/3] }
"""
CLAIM = r"""
- id: "3.1d"
  section: stability
  title: "β is not small"
  statement: '$\beta$ is not small'
  where: "Lemma 3.1"
  verdict: "holds"
  check: stability.at_ratio
  parameters: { H_over_h: 2, table: "{scene}/infsup", scenes: [square], variable: beta_lower, least: 0.6 }
  reads: ["{scene}/infsup"]
  source: "a round number"
  control: { what: "beta halved", tables: [square/infsup], variable: beta_lower, factor: 0.5 }
"""
KIND = """

def calm(values: Array, h: float, H: float, budget: Budget) -> Axis:
    return nothing(values, h, H, budget)
"""
AXIS = """\
    calm: { kind: calm, label: "a new kind", values: [1/2, 1/4] }
"""
PLACES = [
    ("src/unilateral/geometry/polygons.yaml", "", "pentagon: [[0, 0], [2, 0], [2, 1], [1, 2], [0, 1]]\n"),
    ("manufactured/added.yaml", "", EXAMPLE.split("```yaml\n")[1].split("```")[0]),
    ("workflow/config/rates.yaml", "  cases:\n", f"    added: {{ h1: {RATE}, hm12: {RATE}, l2: {RATE} }}\n"),
    ("workflow/config/study.yaml", "    cases: [natural, thirds", ", added"),
    ("workflow/config/study.yaml", "\nscenes:\n", SCENE),
    ("workflow/config/study.yaml", "\nsurveys:\n", SURVEY),
    ("src/unilateral/study/judge/ledger.yaml", "scenes: [betasquare", ", betaadded"),
    (
        "src/unilateral/study/figures/again.py",
        "",
        (ROOT / "src/unilateral/study/figures/multiplier.py").read_text(),
    ),
    ("workflow/config/figures.yaml", "figures:\n", FIGURE),
    ("src/unilateral/study/judge/ledger.yaml", "", CLAIM),
    ("src/unilateral/study/runs/extremes/contact.py", "", KIND),
    ("workflow/config/extremes.yaml", "  axes:\n", AXIS),
]
"""What is added to a file, and behind which text or, without one, at its end.

A figure has its example in tests/study/figures/pages.py, too.
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
    targets = ["results/added/rates.nc", "figures/again.svg"]
    table = run(project, "-m", "snakemake", "-n", "-c1", *targets).partition("Job stats:")[2]
    jobs = {"dual_norm": 1, "solve": 1, "rates": 1, "survey": 1, "figure": 1, "total": 5}
    assert {rule: int(count) for rule, count in re.findall(r"^(\w+) +(\d+)$", table, re.MULTILINE)} == jobs
    code = (
        "from unilateral.study.judge.claims import find; from unilateral.study.runs.extremes import KINDS; "
    )
    code += "print(find('3.1d').reads, KINDS['calm'].__module__)"
    assert run(project, "-c", code) == "('square/infsup',) unilateral.study.runs.extremes.contact\n"
