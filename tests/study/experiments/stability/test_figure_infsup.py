"""The figure of the inf-sup constant: the numbers of its table, and only those."""

import pytest
from pages import drawn, page, pairs, points, said, table


def test_beta_stands_over_the_ratio_and_over_delta():
    """Lower bounds: on the left of the uniform scenes only, elsewhere of all; and none but the table's."""
    rows = table("infsup")
    uniform, ratio, inner = page("infsup")[0].axes
    of_uniform = rows[rows["kind"] == "uniform"]
    assert points(uniform) == pairs(of_uniform, "h_over_H", "beta_lower")
    assert points(ratio) == pairs(rows, "h_over_H", "beta_lower")
    curve = {(x, y) for x, y in points(inner) if abs(y - 2 * x * (1 - x)) < 1e-8}
    assert len(curve) >= 50
    assert points(inner) - curve == pairs(rows, "delta", "beta_lower") - curve


@pytest.mark.parametrize("beta", [0.0, 0.2])
def test_the_axis_is_cut_only_where_beta_is_zero_beyond(beta):
    """The note gives the width of the bounds if it is known."""
    rows = table("infsup")
    rows.loc[rows["h_over_H"] > 1.05, ["beta_lower", "beta_upper"]] = beta
    given = rows.assign(widest=0.0123) if beta else rows.drop(columns="widest")
    figure, _ = drawn("infsup", given)
    last = rows["h_over_H"][rows["kind"] == "uniform"].max()
    assert (figure.axes[0].get_xlim()[1] < last) == (beta == 0)
    texts = said(figure)
    assert sum("$0$ up\nto" in text for text in texts) == (beta == 0)
    assert any("at most 1.3 % higher" in text for text in texts) == (beta > 0)
    assert any("%" in text for text in texts) == (beta > 0)
