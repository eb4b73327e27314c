"""The examples of docs/adding.md: all of them are added to a copy of the project, and planned.

The small experiment is run, and its claim judged; the rest is not. A plan by Snakemake and a program
that imports the library take some seconds.

Control: in test_configuration.py what is named and not added, too, is refused.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

from conftest import copy_project
from documents import blocks

CASE = next(block.text for block in blocks("manufactured/README.md") if block.kind == "yaml")
POLYGON, RATES, SCENE, SURVEY, MEASURE, SCHEMA, FIELDS, RULE, SCRIPT, *OTHERS = [
    block.text for block in blocks("docs/adding.md")
]
DRAWING, DRAWING_RULE, DRAWING_SCRIPT, FIGURE, CLAIM, AXIS = OTHERS
COUNTED = """claims:
- id: "V.h"
  title: "as many unknowns as nodes"
  statement: 'a structured mesh of the square has $(1/h + 1)^2$ nodes'
  where: "section 2"
  verdict: "holds"
  check: ledger.worst
  parameters:
    table: counts/counts
    value: np.abs(unknowns - (1 / h + 1) ** 2)
    at_most: 0
    quantity: the largest difference
  reads: [counts/counts]
  source: "derived: by counting"
  control: { what: "a hundredth more", tables: [counts/counts], variable: unknowns, factor: 1.01 }
"""
"""The claims of the experiment that is added."""
STABILITY = "src/study/experiments/stability"
COUNTS = "src/study/experiments/counts"
EXTREMES = "src/study/experiments/extremes"
PLACES = [
    ("src/unilateral/geometry/polygons.yaml", "", POLYGON),
    ("manufactured/my_case.yaml", "", CASE),
    ("workflow/config/rates.yaml", "  cases:\n", RATES),
    ("workflow/config/study.yaml", "\nscenes:\n", SCENE),
    ("workflow/config/study.yaml", "\nsurveys:\n", SURVEY),
    (f"{STABILITY}/claims.yaml", "parameters: { scenes: [betasquare", ", mysurvey"),
    (f"{COUNTS}/__init__.py", "", '"""Unknowns, counted."""\n'),
    (f"{COUNTS}/measure.py", "", MEASURE),
    (f"{COUNTS}/schema.yaml", "", SCHEMA),
    (f"{COUNTS}/claims.yaml", "", COUNTED),
    ("workflow/config/study.yaml", "", FIELDS),
    ("workflow/rules/experiments.smk", "", f"\n\n{RULE}"),
    ("workflow/scripts/counts.py", "", SCRIPT),
    ("src/study/ledger/sections.yaml", "extremes: [", '"V.h", '),
    (f"{COUNTS}/counts_figure.py", "", DRAWING),
    ("workflow/rules/figures.smk", "which is made from results.\n", f"\n\n{DRAWING_RULE}"),
    ("workflow/scripts/draw_counts.py", "", DRAWING_SCRIPT),
    ("workflow/config/figures.yaml", "figures:\n", FIGURE),
    (f"{STABILITY}/claims.yaml", "", "\n" + CLAIM),
    ("src/study/ledger/sections.yaml", "stability: [", '"3.1d", '),
    (f"{EXTREMES}/measure.py", "] = {\n", '    "calm": data_axes.zero_data_axis,\n'),
    (f"{EXTREMES}/schema.yaml", "[ratio, ", "calm, "),
    ("workflow/config/extremes.yaml", "  axes:\n", AXIS),
]
"""What is added to a file, and behind which text or, without one, at its end."""

USED = """
from study.experiments.counts.measure import measure_counts
from study.experiments.extremes.measure import AXES
from study.ledger.claims import find_claim
from study.experiments.counts.counts_figure import draw, table
from study.tables import load_table, save_csv

measure_counts({"polygon": "square", "h": ["1/8", "1/16"]}, "counts/counts.nc")
print(find_claim("V.h").measure({"counts/counts": load_table("counts/counts.nc")}).observed)
print(find_claim("3.1d").reads)
print(AXES["calm"].__module__)
files = "counts/counts.csv", "counts/counts.svg"
save_csv(table("counts/counts.nc"), files[0])
draw(*files)
print(*open(files[0]).read().split())
print(open(files[1]).read().count("<svg"))
"""
"""A program that uses what is added: the experiment, its claim and its figure, another claim, an axis."""


def run(folder: Path, *arguments: str) -> str:
    """What a program says that uses the library in that folder."""
    command = [sys.executable, *arguments]
    environment = {**os.environ, "PYTHONPATH": f"{folder / 'src'}:{folder}"}
    process = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=60)
    assert process.returncode == 0, process.stderr
    return process.stdout + process.stderr


def test_what_is_added_is_planned_and_needs_no_other_change(tmp_path: Path) -> None:
    project = copy_project(tmp_path)
    (project / "src/unilateral/manufactured").symlink_to(project / "manufactured")
    for name, marker, text in PLACES:
        file = project / name
        file.parent.mkdir(exist_ok=True)
        old = file.read_text(encoding="utf-8") if file.exists() else ""
        assert old.count(marker) == 1 or not marker, name
        index = old.index(marker) + len(marker) if marker else len(old)
        file.write_text(old[:index] + text + old[index:], encoding="utf-8")
    targets = ["results/myscene/rates.nc", "results/mysurvey/infsup.nc", "figures/counts.svg"]
    table = run(project, "-m", "snakemake", "-n", "-c1", *targets).partition("Job stats:")[2]
    jobs = dict.fromkeys(["dual_norm", "solve", "rates", "surveys", "counts", "draw_counts"], 1) | {
        "total": 6
    }
    assert {rule: int(count) for rule, count in re.findall(r"^(\w+) +(\d+)$", table, re.MULTILINE)} == jobs
    (project / "counts").mkdir()
    texts = ["0.0", "('square/infsup',)", "study.experiments.extremes.data_axes"]
    texts += ["h,unknowns 0.125,81 0.0625,289", "1"]
    assert run(project, "-c", USED).splitlines() == texts
