"""The figure of all verdicts: its table, and every claim at its margin."""

import json

import pytest
from pages import page, table

from unilateral.study.figures import verdict as figure_of_verdicts
from unilateral.study.judge import claims


def made(folder, records):
    """The table of these claims."""
    (folder / "claims.json").write_text(
        json.dumps([{"id": "4.1", "margin": 0.37, **each} for each in records])
    )
    return figure_of_verdicts.table(folder / "claims.json")


KINDS = {
    "holds": "holds",
    "holds and is sharp": "holds, and is sharp",
    "holds; not sharp but as alpha -> 0": "holds",
    "holds; the rate is larger, so sharp as alpha -> 0": "holds, and is sharp",
    "needs h/H small": "needs a condition that is left out",
    "is an error of the source": "is an error of the source",
    "is supported by every run": "supported beyond the paper",
    "fails": "fails",
}


def test_the_kinds_of_verdicts(tmp_path):
    """No verdict of the ledger is taken for a failure."""
    found = made(tmp_path, [{"verdict": verdict} for verdict in KINDS])
    assert found["kind"].tolist() == [*KINDS.values()]
    assert "fails" not in set(
        made(tmp_path, [{"verdict": claim.verdict} for claim in claims.ledger()])["kind"]
    )


def test_margins_end_where_the_axis_does(tmp_path):
    found = made(tmp_path, [{"verdict": "holds", "margin": m} for m in (1e-9, 0.5, 1e9)])
    assert found["margin"].tolist() == [1e-4, 0.5, 10.0]


def test_the_figure_shows_every_claim():
    """From the top of two panels of equal heights."""
    panels, rows = page("verdict")[0].axes, table("verdict")
    shown = [float(line.get_xdata()[0]) for axes in panels for line in axes.lines]
    assert shown == pytest.approx(rows["margin"].tolist())
    named = [label.get_text() for axes in panels for label in axes.get_yticklabels()]
    assert named == rows["label"].tolist()
    places = (len(rows) + 1) // 2
    heights = [[float(line.get_ydata()[0]) for line in axes.lines] for axes in panels]
    assert heights[0] == [*range(places - 1, -1, -1)]
    assert heights[1] == heights[0][: len(rows) - places]
