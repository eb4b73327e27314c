"""What holds for all figures: they are what their tables give, whoever draws them, and on the page."""

import os
import re
import subprocess
import sys

import pytest
from conftest import ROOT, config
from matplotlib import rc_context
from matplotlib.text import Text
from pages import FIGURES, NAMES, module_of, modules, page, recorded

from unilateral.errors import InputError

ODD = {"lines.linewidth": 9, "axes.facecolor": "red", "svg.hashsalt": None, "savefig.bbox": "tight"}


def test_every_committed_figure_is_drawn_and_nothing_else_is_there():
    """By the entries of the configuration; a module draws each."""
    names = []
    for entry, figure in config("figures")["figures"].items():
        names += [f"{entry}_{scene}" for scene in figure["scenes"]] if "scenes" in figure else [entry]
    files = {f"{name}.{kind}" for name in names for kind in ("csv", "svg")}
    assert files == {file.name for file in (ROOT / "figures").iterdir()}
    assert {module_of(name) for name in names} == set(modules().values())


@pytest.mark.parametrize("name", FIGURES)
def test_a_committed_figure_is_what_its_table_gives_and_on_the_page(name, tmp_path):
    """Whatever settings a user has. Text is drawn as paths, and there is no date."""
    target = tmp_path / "figure.svg"
    draw = module_of(name).draw
    with rc_context(ODD), recorded() as pages:
        draw(ROOT / f"figures/{name}.csv", target)
    svg = target.read_bytes()
    assert svg == (ROOT / f"figures/{name}.svg").read_bytes()
    assert svg.startswith(b"<?xml")
    assert not re.search(rb"\d{4}-\d\d-\d\d|dc:date|<text", svg)
    check_page(pages[0])


def check_page(figure):
    """Text as large as in a paper, nothing beyond the page, 17 cm wide."""
    (width, height), box = figure.get_size_inches(), figure.get_tightbbox()
    assert width == pytest.approx(17 / 2.54)
    seen = [text for text in figure.findobj(Text) if text.get_visible() and text.get_text()]
    assert [text.get_text() for text in seen if float(text.get_fontsize()) < 8] == []
    assert min(box.x0, box.y0) >= 0
    assert box.x1 <= width
    assert box.y1 <= height


@pytest.mark.parametrize(("x", "size"), [(0.99, 10), (0.5, 7)])
def test_what_is_beyond_the_page_or_too_small_is_seen(x, size):
    """Control."""
    figure = page("multiplier")[0]
    check_page(figure)
    added = figure.text(x, 0.5, "beyond the page", size=size)
    with pytest.raises(AssertionError):
        check_page(figure)
    added.remove()
    check_page(figure)


def test_another_process_gives_the_same_bytes(tmp_path):
    """With other seeds of its hashes and another time zone; and without what of matplotlib has windows.

    Takes seconds, for it draws a figure of every module.
    """
    program = "import sys\nfrom importlib import import_module\n"
    drawn = {module: NAMES.get(name, name) for name, module in modules().items()}
    for module, name in drawn.items():
        files = str(ROOT / f"figures/{name}.csv"), f"{name}.svg"
        program += f"import_module('{module.__name__}').draw(*{files})\n"
    program += "assert 'matplotlib.pyplot' not in sys.modules"
    environment = {**os.environ, "PYTHONHASHSEED": "12345", "TZ": "Asia/Tokyo"}
    subprocess.run([sys.executable, "-c", program], cwd=tmp_path, env=environment, check=True)
    for name in drawn.values():
        assert (tmp_path / f"{name}.svg").read_bytes() == (ROOT / f"figures/{name}.svg").read_bytes()


@pytest.mark.parametrize("figure", modules())
def test_another_table_gives_another_figure(figure):
    """Control."""
    others = {(ROOT / f"figures/{name}.svg").read_bytes() for name in FIGURES}
    assert page(figure)[1] not in others


@pytest.mark.parametrize("figure", modules())
def test_a_table_that_is_missing_is_named(figure, tmp_path):
    given = tmp_path / "missing.csv"
    with pytest.raises(InputError, match=r"there is no table .*missing\.csv"):
        modules()[figure].draw(given, tmp_path / "figure.svg")
    assert list(tmp_path.iterdir()) == []
