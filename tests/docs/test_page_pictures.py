"""Pictures of the pages are what the pages' own code draws."""

import re

import matplotlib as mpl
import numpy as np
import pytest
from conftest import ROOT
from documents import blocks

PICTURES = {"docs/time-steps.md": "time-steps.svg"}
PRINTED = 0.05
"""In points: what the last digits of another processor may move."""


def drawn(page, folder, monkeypatch, change=("", "")):
    """The picture that the Python of a page writes into a folder, as committed ones were drawn."""
    monkeypatch.chdir(folder)
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "0")
    (folder / "examples").symlink_to(ROOT / "examples")
    programs = (block.text for block in blocks(page) if block.kind == "python" and block.reason is None)
    with mpl.rc_context({"svg.hashsalt": "unilateral"}):
        exec(compile("\n".join(programs).replace(*change), page, "exec"), {"__name__": "__main__"})
    return (folder / PICTURES[page]).read_text(encoding="utf-8")


def lines(picture):
    """All numbers of its lines and areas; letters are lines, too."""
    found = " ".join(re.findall(r' d="([^"]*)"', picture))
    return np.array([float(number) for number in re.findall(r"-?\d+\.?\d*", found)])


@pytest.mark.parametrize("page", PICTURES)
def test_a_committed_picture_is_what_its_page_draws(page, tmp_path, monkeypatch):
    """Control: another stamp."""
    committed = (ROOT / "docs/static" / PICTURES[page]).read_text(encoding="utf-8")
    now = drawn(page, tmp_path, monkeypatch)
    np.testing.assert_allclose(lines(now), lines(committed), rtol=0, atol=PRINTED)
    (tmp_path / "other").mkdir()
    other = lines(drawn(page, tmp_path / "other", monkeypatch, ("2*(x - 1/2)", "(x - 1/2)")))
    assert len(other) != len(lines(committed)) or np.abs(other - lines(committed)).max() > 1
    assert f"](static/{PICTURES[page]})" in (ROOT / page).read_text(encoding="utf-8")
