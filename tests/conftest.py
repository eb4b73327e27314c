"""What several test files share: discrete problems, built once."""

from __future__ import annotations

import os
import subprocess
import sys
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.transforms import Bbox

from unilateral.discrete import Discrete, with_solution
from unilateral.fem.condense import Condensed, condense
from unilateral.fem.spaces import MixedSpaces, mixed_spaces
from unilateral.geometry import partition as partitions
from unilateral.geometry.polygon import named
from unilateral.geometry.structured import structured
from unilateral.norms.exact import Exact, cell_means, ritz_projection
from unilateral.problems import case as cases
from unilateral.problems.case import Case

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


@cache
def load(name: str, polygon: str = "square", side: int = 0) -> Case:
    return cases.load(name, named(polygon), side)


@cache
def condensed(polygon: str, n: int) -> Condensed:
    """A structured mesh with h = 1/n, factorised."""
    return condense(structured(named(polygon), 1 / n))


@cache
def coupled(polygon: str, n: int, m: int) -> MixedSpaces:
    return mixed_spaces(condensed(polygon, n), partitions.uniform(named(polygon), 1 / m))


@cache
def discrete(name: str, n: int, m: int, polygon: str = "square", degree: int | None = None) -> Discrete:
    """The case on its first side, h = 1/n, H = 1/m, and its exact solution."""
    case, spaces = load(name, polygon), coupled(polygon, n, m)
    ritz = ritz_projection(case, spaces.condensed, degree)
    return with_solution(spaces, Exact(ritz, cell_means(case, spaces.partition)))


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
