"""The figure of all verdicts: its table, and every claim at its margin."""

import json

import pytest

from examples import drawn_from
from unilateral.study.figures import verdict as figure_of_verdicts
from unilateral.study.judge import claims


def record(**changed):
    return {"id": "4.1", "verdict": "holds", "margin": 0.37, **changed}


def made(folder, records):
    """The table of these claims."""
    (folder / "claims.json").write_text(json.dumps(records))
    return figure_of_verdicts.table(folder / "claims.json")


@pytest.mark.parametrize(
    ("verdict", "kind"),
    [
        ("holds", "holds"),
        ("holds and is sharp", "holds, and is sharp"),
        ("holds; not sharp but as alpha -> 0", "holds"),
        ("holds; the rate is larger, so sharp as alpha -> 0", "holds, and is sharp"),
        ("needs h/H small", "needs a condition that is left out"),
        ("is an error of the source", "is an error of the source"),
        ("is supported by every run", "supported beyond the paper"),
        ("fails", "fails"),
    ],
)
def test_the_kinds_of_verdicts(verdict, kind, tmp_path):
    assert made(tmp_path, [record(verdict=verdict)])["kind"].tolist() == [kind]


def test_margins_end_where_the_axis_does(tmp_path):
    found = made(tmp_path, [record(margin=m) for m in (1e-9, 0.5, 1e9)])
    assert found["margin"].tolist() == [1e-4, 0.5, 10.0]


def test_no_verdict_of_the_ledger_is_taken_for_a_failure(tmp_path):
    records = [record(verdict=claim.verdict) for claim in claims.ledger()]
    assert "fails" not in set(made(tmp_path, records)["kind"])


def test_the_figure_shows_every_claim(tmp_path, drawn):
    table = made(tmp_path, [record(id=f"4.{k}", margin=0.1 * k) for k in range(1, 6)])
    drawn_from("verdict", tmp_path, verdict=table)
    figure = drawn[0][0]
    shown = [float(line.get_xdata()[0]) for axes in figure.axes for line in axes.lines]
    assert shown == pytest.approx([0.1, 0.2, 0.3, 0.4, 0.5])
    named = [[label.get_text() for label in axes.get_yticklabels()] for axes in figure.axes]
    assert named == [["4.1", "4.2", "4.3"], ["4.4", "4.5"]]
    heights = [[float(line.get_ydata()[0]) for line in axes.lines] for axes in figure.axes]
    assert heights == [[2, 1, 0], [2, 1]]
