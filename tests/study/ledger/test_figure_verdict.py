"""The figure of all verdicts: its table, and every claim at its margin."""

import json

import pytest
from pages import page, table

from study.ledger import claims
from study.ledger import verdict_figure as figure_of_verdicts


def tabulate_claims(folder, records):
    """The table of these claims."""
    (folder / "claims.json").write_text(
        json.dumps([{"id": "4.1", "title": "a title", "margin": 0.37, **record} for record in records])
    )
    return figure_of_verdicts.table(folder / "claims.json")


KINDS = {
    "holds": "holds",
    "holds and is sharp": "holds, and is sharp",
    "holds; not sharp but as alpha -> 0": "holds",
    "holds; the rate is larger, so sharp as alpha -> 0": "holds, and is sharp",
    "needs h/H small": "needs a condition that is left out",
    "is an error of the source": "is an error of the source",
    "is supported by every run": "supported by numbers",
    "fails": "fails",
}


def test_every_verdict_is_of_one_kind(tmp_path):
    """No verdict of the ledger is taken for a failure."""
    nested = tabulate_claims(tmp_path, [{"verdict": verdict} for verdict in KINDS])
    assert nested["kind"].tolist() == [*KINDS.values()]
    assert "fails" not in set(
        tabulate_claims(
            tmp_path, [{"verdict": claim.verdict} for claim in claims.load_ledger() if claim.check]
        )["kind"]
    )


def test_what_has_no_check_is_left_out(tmp_path):
    """It has no margin, so it would stand at the axis' end. Control: what is not judged is shown there."""
    reasons = [{"verdict": f"{why}: it is"} for why in ("nothing to measure", "not judged")]
    nested = tabulate_claims(tmp_path, [{"margin": None, **reason} for reason in reasons])
    assert nested["kind"].tolist() == ["not judged"]


def test_margins_end_where_the_axis_does(tmp_path):
    nested = tabulate_claims(tmp_path, [{"verdict": "holds", "margin": m} for m in (1e-9, 0.5, 1e9)])
    assert nested["margin"].tolist() == [1e-4, 0.5, 10.0]


def test_the_figure_shows_every_claim():
    """From the top of two panels of equal heights."""
    panels = page("verdict")[0].axes
    rows = table("verdict")
    values = [float(line.get_xdata()[0]) for axes in panels for line in axes.lines]
    assert values == pytest.approx(rows["margin"].tolist())
    named = [text.get_text() for axes in panels for text in axes.texts]
    assert named == rows[["id", "title"]].to_numpy().ravel().tolist()
    places = (len(rows) + 1) // 2
    heights = [[float(line.get_ydata()[0]) for line in axes.lines] for axes in panels]
    assert heights[0] == [*range(places - 1, -1, -1)]
    assert heights[1] == heights[0][: len(rows) - places]


def test_ids_titles_and_axes_stand_beside_each_other():
    """No id runs into its title, and no title into the axis: of a title of twice the length it would."""
    figure = page("verdict")[0]
    figure.draw_without_rendering()
    for axes in figure.axes:
        boxes = [text.get_window_extent() for text in axes.texts]
        ids = boxes[::2]
        titles = boxes[1::2]
        end = axes.get_window_extent().x0
        assert max(box.x1 for box in ids) < min(box.x0 for box in titles)
        assert max(box.x1 for box in titles) < end < max(box.x0 + 2 * box.width for box in titles)
