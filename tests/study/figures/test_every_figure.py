"""What holds for all figures: the same bytes from the same table, bad tables refused, never half a file."""

import re
from functools import cache
from importlib import import_module
from pathlib import Path

import pandas as pd
import pytest
from conftest import ROOT, check_page, run_elsewhere
from matplotlib import rc_context
from matplotlib.figure import Figure

from examples import EXAMPLES, draw, write
from unilateral.errors import InputError, StorageError
from unilateral.study import config, drawings


@cache
def committed():
    """The figures in git."""
    files = [str(file) for file in sorted((ROOT / "workflow/config").glob("*.yaml"))]
    study, sources = config.read(files)
    config.check(study, sources, str(ROOT / "workflow/schemas/study.schema.yaml"))
    found = drawings.drawings(study)
    return {path: found[path] for path in found if path.startswith("figures/")}


@pytest.fixture
def folder(tmp_path):
    for figure in EXAMPLES:
        write(figure, tmp_path)
    return tmp_path


def test_every_figure_has_an_example():
    assert sorted(EXAMPLES) == drawings.modules()


def test_every_committed_figure_is_drawn_and_nothing_else_is_there():
    files = {f"{path}.svg" for path in committed()}
    files |= {f"{table}.csv" for drawing in committed().values() for table in drawing.parts}
    assert files == {f"figures/{file.name}" for file in (ROOT / "figures").iterdir()}


@pytest.mark.parametrize("path", committed())
def test_a_committed_figure_is_what_its_tables_give_and_on_the_page(path, tmp_path, drawn):
    drawing = committed()[path]
    module = import_module(f"unilateral.study.figures.{drawing.module}")
    module.draw(*(ROOT / f"{table}.csv" for table in drawing.parts), tmp_path / "figure.svg", **drawing.look)
    assert (tmp_path / "figure.svg").read_bytes() == (ROOT / f"{path}.svg").read_bytes()
    check_page(*drawn[0])


@pytest.mark.parametrize("figure", EXAMPLES)
def test_the_same_table_gives_the_same_bytes(figure, folder):
    first = draw(figure, folder)
    assert draw(figure, folder, "again.svg") == first
    name = next(iter(EXAMPLES[figure].tables))
    changed = pd.read_csv(folder / name)
    changed.loc[1, EXAMPLES[figure].seen] += 0.3
    changed.to_csv(folder / name, index=False)
    assert draw(figure, folder) != first


def test_another_process_gives_the_same_bytes(folder):
    first = {figure: draw(figure, folder, f"{figure}.svg") for figure in EXAMPLES}
    program = "import sys\nfrom importlib import import_module\n"
    for figure, example in EXAMPLES.items():
        files = [*example.tables, f"{figure}.svg"]
        program += f"import_module('unilateral.study.figures.{figure}').draw(*{files})\n"
        (folder / f"{figure}.svg").unlink()
    run_elsewhere(program + "assert 'matplotlib.pyplot' not in sys.modules", folder)
    assert {figure: (folder / f"{figure}.svg").read_bytes() for figure in EXAMPLES} == first


@pytest.mark.parametrize("figure", EXAMPLES)
def test_a_figure_depends_on_no_setting_of_the_user(figure, folder):
    first = draw(figure, folder)
    with rc_context(
        {"lines.linewidth": 9, "axes.facecolor": "red", "svg.hashsalt": None, "savefig.bbox": "tight"}
    ):
        assert draw(figure, folder, "again.svg") == first


@pytest.mark.parametrize("figure", EXAMPLES)
def test_text_is_as_large_as_in_a_paper_and_on_the_page(figure, folder, drawn):
    """Text is drawn as paths, and there is no date."""
    svg = draw(figure, folder).decode()
    assert svg.startswith("<?xml")
    assert not re.search(r"\d{4}-\d\d-\d\d|dc:date|<text", svg)
    check_page(*drawn[0])


def refused(figure, name, said, folder):
    """What is said of a table that is refused; nothing is written."""
    before = sorted(folder.iterdir())
    with pytest.raises(InputError, match=said) as raised:
        draw(figure, folder)
    assert name in str(raised.value)
    assert sorted(folder.iterdir()) == before
    return str(raised.value)


@pytest.mark.parametrize("figure", EXAMPLES)
def test_a_table_that_is_missing_is_named(figure, folder):
    name = next(iter(EXAMPLES[figure].tables))
    (folder / name).unlink()
    refused(figure, name, "there is no table", folder)


@pytest.mark.parametrize("figure", EXAMPLES)
def test_a_failure_while_writing_leaves_the_old_figure(figure, folder, monkeypatch):
    (folder / "figure.svg").write_text("old")
    before = sorted(folder.iterdir())

    def breaking(_, path, **options):
        Path(path).write_text("<svg half")
        raise OSError("no space left on device")

    with monkeypatch.context() as patched:
        patched.setattr(Figure, "savefig", breaking)
        with pytest.raises(StorageError, match="no space"):
            draw(figure, folder)
    assert (folder / "figure.svg").read_text() == "old"
    assert sorted(folder.iterdir()) == before
    assert draw(figure, folder) != b"old"
