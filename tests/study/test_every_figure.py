"""What holds for all figures: they are what their tables give, whoever draws them, and on the page."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import ROOT, config
from pages import FIGURES, faults, module_of, modules, page

from unilateral.errors import InputError


@pytest.fixture(scope="module")
def redrawn_figures(tmp_path_factory):
    """A folder with all figures in git, drawn from their tables, and what is wrong with the page of each.

    By another process, with other seeds of its hashes, in another time zone, with odd settings of a user.
    """
    folder = tmp_path_factory.mktemp("figures")
    path = os.pathsep.join([str(ROOT), str(Path(__file__).parent), os.environ.get("PYTHONPATH", "")])
    environment = {**os.environ, "PYTHONHASHSEED": "12345", "TZ": "Asia/Tokyo", "PYTHONPATH": path}
    command = [sys.executable, Path(__file__).with_name("redraw.py")]
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    return folder, json.loads(done.stdout)


def test_every_committed_figure_is_drawn_and_nothing_else_is_there():
    """By the entries of the configuration; a module draws each."""
    names = []
    for entry, figure in config("figures")["figures"].items():
        names += [f"{entry}_{scene}" for scene in figure["scenes"]] if "scenes" in figure else [entry]
    files = {f"{name}.{kind}" for name in names for kind in ("csv", "svg")}
    assert files == {file.name for file in (ROOT / "figures").iterdir()}
    assert {module_of(name) for name in names} == set(modules().values())


@pytest.mark.parametrize("name", FIGURES)
def test_a_committed_figure_is_what_its_table_gives_and_on_the_page(name, redrawn_figures):
    """Text is drawn as paths, and there is no date."""
    folder, faults_of_pages = redrawn_figures
    svg = (folder / f"{name}.svg").read_bytes()
    assert svg == (ROOT / f"figures/{name}.svg").read_bytes()
    assert svg.startswith(b"<?xml")
    assert not re.search(rb"\d{4}-\d\d-\d\d|dc:date|<text", svg)
    assert faults_of_pages[name] == []


@pytest.mark.parametrize(("x", "size", "fault"), [(0.99, 10, "beyond the page: "), (0.5, 7, "small: added")])
def test_what_is_beyond_the_page_or_too_small_is_seen(x, size, fault):
    """Control."""
    figure = page("multiplier")[0]
    assert faults(figure) == []
    added = figure.text(x, 0.5, "added text", size=size)
    (sentence,) = faults(figure)
    assert sentence.startswith(fault)
    added.remove()
    assert faults(figure) == []


@pytest.mark.parametrize("figure", ["benchmarks", "multiplier", "work_precision"])
def test_another_table_gives_another_figure(figure):
    """Control. What others draw of other numbers is in tests of their own."""
    committed_figures = {(ROOT / f"figures/{name}.svg").read_bytes() for name in FIGURES}
    assert page(figure)[1] not in committed_figures


@pytest.mark.parametrize("figure", modules())
def test_a_table_that_is_missing_is_named(figure, tmp_path):
    missing_table = tmp_path / "missing.csv"
    with pytest.raises(InputError, match=r"there is no table .*missing\.csv"):
        modules()[figure].draw(missing_table, tmp_path / "figure.svg")
    assert list(tmp_path.iterdir()) == []
