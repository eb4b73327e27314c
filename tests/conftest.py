"""What several test files share: discrete problems, built once."""

import os
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest
from matplotlib.figure import Figure
from matplotlib.text import Text

from unilateral.discrete import with_solution
from unilateral.fem.condense import condense
from unilateral.fem.spaces import mixed_spaces
from unilateral.geometry import mesh as meshes
from unilateral.geometry import partition as partitions
from unilateral.geometry.polygon import named
from unilateral.norms.exact import Exact, cell_means, ritz_projection
from unilateral.problems import case as cases

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


@pytest.fixture
def drawn(monkeypatch):
    """The figures as they are written, each with the box, in inches, of all that is seen of it."""
    found = []
    savefig = Figure.savefig

    def recording(figure, *arguments, **options):
        savefig(figure, *arguments, **options)
        figure.draw_without_rendering()
        found.append((figure, figure.get_tightbbox()))

    monkeypatch.setattr(Figure, "savefig", recording)
    return found


def texts(figure):
    """What is written in a figure."""
    found = [artist for artist in figure.findobj(Text) if isinstance(artist, Text)]
    return [text for text in found if text.get_visible() and text.get_text()]


def check_page(page, box):
    """Text as large as in a paper, nothing beyond the page, 17 cm wide; what were beyond it would be seen."""
    width, height = page.get_size_inches()
    assert width == pytest.approx(17 / 2.54)
    assert [text.get_text() for text in texts(page) if float(text.get_fontsize()) < 8] == []
    assert min(box.x0, box.y0) >= 0
    assert box.x1 <= width
    assert box.y1 <= height
    page.text(0.99, 0.5, "beyond the page")
    assert page.get_tightbbox().x1 > width


def run_elsewhere(program, folder):
    """A program run in another process, with other seeds of its hashes and another time zone."""
    environment = {**os.environ, "PYTHONHASHSEED": "12345", "TZ": "Asia/Tokyo"}
    subprocess.run([sys.executable, "-c", program], cwd=folder, env=environment, check=True)
