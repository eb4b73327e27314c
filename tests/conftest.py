"""What several test files share: discrete problems, built once."""

from __future__ import annotations

import os
import subprocess
import sys
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.transforms import Bbox

from unilateral.discrete import Pair, Solution, guarded_beta, pair, solve
from unilateral.fem.condense import Condensed, condense
from unilateral.geometry import mesh as meshes
from unilateral.geometry import partition as partitions
from unilateral.geometry.polygon import named
from unilateral.norms.exact import CellMeans, RitzProjection, cell_means, ritz_projection
from unilateral.problems import case as cases
from unilateral.problems.case import Case
from unilateral.solvers.iterate import Stop

ROOT = Path(__file__).parents[1]
DATA = ROOT / "tests/data"
RESULTS = ROOT / "results"
NEED_RESULTS = ("test_claims.py", "test_documents.py", "test_surveys.py")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Without the study's results a run that would judge them ends at once, and says what to run."""
    if any(_needs_results(item.path.name) for item in items) and not any(RESULTS.glob("*/rates.nc")):
        pytest.exit("The tests judge the study's results, and there are none: run 'make' first.", 1)


def _needs_results(name: str) -> bool:
    return name.startswith("test_results") or name in NEED_RESULTS


class Discrete(NamedTuple):
    """A case on a mesh and a partition."""

    problem: RitzProjection
    cells: CellMeans
    both: Pair
    beta: float

    def solve(self, stop: Stop | None = None) -> Solution:
        return solve(*self, stop or Stop())


@cache
def load(name: str, polygon: str = "square", side: int = 0) -> Case:
    return cases.load(name, named(polygon), side)


@cache
def condensed(polygon: str, n: int) -> tuple[Condensed, float]:
    """A structured mesh with h = 1/n, factorised, and its first Steklov eigenvalue."""
    on = condense(meshes.structured(named(polygon), 1 / n))
    return on, on.sigma_1


@cache
def coupled(polygon: str, n: int, m: int) -> Pair:
    return pair(condensed(polygon, n)[0], partitions.uniform(named(polygon), 1 / m))


@cache
def discrete(name: str, n: int, m: int, polygon: str = "square", degree: int | None = None) -> Discrete:
    """The case on its first side, h = 1/n, H = 1/m."""
    case, (on, sigma_1) = load(name, polygon), condensed(polygon, n)
    both = coupled(polygon, n, m)
    beta = guarded_beta(both, sigma_1)
    return Discrete(ritz_projection(case, on, degree), cell_means(case, both.partition), both, beta)


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> list[tuple[Figure, Bbox]]:
    """The figures as they are written, each with the box, in inches, of all that is seen of it."""
    found: list[tuple[Figure, Bbox]] = []
    savefig = Figure.savefig

    def recording(figure: Figure, *arguments: Any, **options: Any) -> None:
        savefig(figure, *arguments, **options)
        figure.draw_without_rendering()
        found.append((figure, figure.get_tightbbox()))

    monkeypatch.setattr(Figure, "savefig", recording)
    return found


def texts(figure: Figure) -> list[Text]:
    """What is written in a figure."""
    found = [artist for artist in figure.findobj(Text) if isinstance(artist, Text)]
    return [text for text in found if text.get_visible() and text.get_text()]


def check_page(page: Figure, box: Bbox) -> None:
    """Text as large as in a paper, nothing beyond the page, 17 cm wide; what were beyond it would be seen."""
    width, height = page.get_size_inches()
    assert width == pytest.approx(17 / 2.54)
    assert [text.get_text() for text in texts(page) if float(text.get_fontsize()) < 8] == []
    assert min(box.x0, box.y0) >= 0
    assert box.x1 <= width
    assert box.y1 <= height
    page.text(0.99, 0.5, "beyond the page")
    assert page.get_tightbbox().x1 > width


def run_elsewhere(program: str, folder: Path) -> None:
    """A program run in another process, with other seeds of its hashes and another time zone."""
    environment = {**os.environ, "PYTHONHASHSEED": "12345", "TZ": "Asia/Tokyo"}
    subprocess.run([sys.executable, "-c", program], cwd=folder, env=environment, check=True)
