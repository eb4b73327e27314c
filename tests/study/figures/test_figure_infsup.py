"""The figure of the inf-sup constant: the numbers of its table, and only those."""

import pytest
from pages import drawn, page, pairs, points, said, table


def test_beta_stands_over_both_ratios():
    """Lower bounds: on the left of the uniform scenes only, elsewhere of all; and none but the table's."""
    rows = table("infsup").assign(inverse=lambda rows: 1 / rows["edges_per_cell"])
    uniform, ratio, local = page("infsup")[0].axes
    of_uniform = rows[rows["kind"] == "uniform"]
    assert points(uniform) == pairs(of_uniform, "h_over_H", "beta_lower")
    assert points(ratio) == pairs(rows, "h_over_H", "beta_lower")
    assert points(local) == pairs(rows, "inverse", "beta_lower")


@pytest.mark.parametrize("beta", [0.0, 0.2])
def test_an_axis_is_cut_only_where_beta_is_zero_beyond(beta):
    """The note gives the width of the bounds if it is known."""
    rows = table("infsup")
    beyond = (rows["h_over_H"] > 1.05) | (rows["edges_per_cell"] < 0.95)
    rows.loc[beyond, ["beta_lower", "beta_upper"]] = beta
    given = rows.assign(widest=0.0123) if beta else rows.drop(columns="widest")
    figure, _ = drawn("infsup", given)
    uniform, _, local = figure.axes
    last = rows["h_over_H"][rows["kind"] == "uniform"].max(), 1 / rows["edges_per_cell"].min()
    ends = [axes.get_xlim()[1] for axes in (uniform, local)]
    assert [end < x for end, x in zip(ends, last, strict=True)] == [beta == 0] * 2
    texts = said(figure)
    assert sum("$0$ up\nto" in text for text in texts) == (2 if beta == 0 else 0)
    assert any("at most 1.2 % higher" in text for text in texts) == (beta > 0)
    assert any("%" in text for text in texts) == (beta > 0)
