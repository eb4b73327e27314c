"""What several test files share: discrete problems, built once."""

from functools import cache
from pathlib import Path

import pytest
import yaml

from unilateral.discrete import with_solution
from unilateral.fem.condense import condense
from unilateral.fem.spaces import mixed_spaces
from unilateral.geometry import mesh as meshes
from unilateral.geometry import partition as partitions
from unilateral.geometry.polygon import named
from unilateral.norms.exact import Exact, cell_means, ritz_projection
from unilateral.problems import case as cases
from unilateral.study import tables

ROOT = Path(__file__).parents[1]
DATA = ROOT / "tests/data"
RESULTS = ROOT / "results"
NEED_RESULTS = ("test_claims.py", "test_documents.py", "test_surveys.py")


def pytest_collection_modifyitems(items):
    """Without the study's results a run that would judge them ends at once, and says what to run."""
    if any(_needs_results(item.path.name) for item in items) and not any(RESULTS.glob("*/rates.nc")):
        pytest.exit("The tests judge the study's results, and there are none: run 'make' first.", 1)


def _needs_results(name):
    return name.startswith("test_results") or name in NEED_RESULTS


def config(name):
    """A file of the study's configuration."""
    return yaml.safe_load((ROOT / f"workflow/config/{name}.yaml").read_text())


@cache
def stored(name):
    """A table of the study's results."""
    return tables.load(RESULTS / f"{name}.nc")


@cache
def load(name, polygon="square", side=0):
    return cases.load(name, named(polygon), side)


@cache
def condensed(polygon, n):
    """A structured mesh with h = 1/n, factorised."""
    return condense(meshes.structured(named(polygon), 1 / n))


@cache
def coupled(polygon, n, m):
    return mixed_spaces(condensed(polygon, n), partitions.uniform(named(polygon), 1 / m))


@cache
def discrete(name, n, m, polygon="square", degree=None):
    """The case on its first side, h = 1/n, H = 1/m, and its exact solution."""
    case, spaces = load(name, polygon), coupled(polygon, n, m)
    ritz = ritz_projection(case, spaces.condensed, degree)
    return with_solution(spaces, Exact(ritz, cell_means(case, spaces.partition)))
