"""What tests of the command line type again and again, and what its JSON has to hold."""

import json
import os
import subprocess
import sys
from pathlib import Path

from conftest import DATA

KEYS = [
    *("problem", "goal", "norm", "certified", "ended", "reach", "k", "c", "norms", "linear_between_nodes"),
    *("h", "diameter", "H"),
    *("adapted", "triangles", "unknowns", "multipliers", "algorithm", "iterations", "foreign", "converged"),
    *("algebraic_bound", "beta", "hm12_algebraic_bound", "unique", "h1_error"),
    *("hm12_error_lower", "hm12_error_upper", "l2_error", "bounds"),
    *("h1_bound", "hm12_bound", "h1_relative_bound", "hm12_relative_bound", "enclosure", "total_bound"),
    *("levels", "contact", "versions", "forces", "seconds", "peak_mb"),
]
"""The fields of `solve --json`, in the documented order."""
SIZES = ("--h", "1/8", "--H", "1/4")
FINER = ("--h", "1/16", "--H", "1/8")
PROBLEM = str(DATA / "problems/triangle.yaml")
OWN_CASE = """\
title: contact everywhere
polygons: any
u: [{ atom: smooth, formula: (x - 1/2)**2 + (y - 1/2)**2 }]
gap: { elsewhere: 0 }
hypotheses: { j: true, jj: true, jjj: true }
asymptotic: { reason: none, h1: { from: 1 }, hm12: { from: 1 }, l2: { from: 1 } }
"""
SCRIPT = Path(sys.executable).with_name("unilateral")


def solve_json(run, *arguments):
    """The exit code of `solve`, what it prints as JSON, in the documented order, and what it tells."""
    code, out, err = run("solve", *arguments, "--json")
    assert out.count("\n") == 1
    document = json.loads(out)
    assert list(document) == KEYS
    return code, document, err


def run_in_python(source, **environment):
    """The exit code of a process that executes this, and what it prints on standard output and error."""
    environment = {**os.environ, **environment}
    command = [sys.executable, "-c", source]
    done = subprocess.run(command, capture_output=True, encoding="utf-8", env=environment, timeout=60)
    return done.returncode, done.stdout, done.stderr
