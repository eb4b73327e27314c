"""The figure of the inf-sup constant: the numbers of its table, and only those."""

import pytest
from conftest import texts

from examples import drawn_from, infsup_table, pairs, points


def test_beta_stands_over_both_ratios(tmp_path, drawn):
    """Lower bounds: on the left of the uniform scenes only, elsewhere of all; and none but the table's."""
    drawn_from("infsup", tmp_path)
    uniform, ratio, local = drawn[0][0].axes
    table = infsup_table().assign(inverse=lambda rows: 1 / rows["edges_per_cell"])
    of_uniform = table[table["kind"] == "uniform"]
    assert points(uniform) == pairs(of_uniform, "h_over_H", "beta_lower")
    assert points(ratio) == pairs(table, "h_over_H", "beta_lower")
    assert points(local) == pairs(table, "inverse", "beta_lower")
    assert points(ratio) != points(local)
    assert points(ratio) != pairs(table, "h_over_H", "beta_upper")


@pytest.mark.parametrize("beta", [0.0, 0.2])
def test_an_axis_is_cut_only_where_beta_is_zero_beyond(beta, tmp_path, drawn):
    table = infsup_table()
    table.loc[(table["kind"] == "uniform") & (table["h_over_H"] == 2), ["beta_lower", "beta_upper"]] = beta
    drawn_from("infsup", tmp_path, infsup=table)
    uniform, _, local = drawn[0][0].axes
    cut = [axes.get_xlim()[1] < 2 for axes in (uniform, local)]
    said = [text.get_text() for text in texts(drawn[0][0])]
    assert cut == [beta == 0] * 2
    assert said.count("$0$ up\nto $2$") == (2 if beta == 0 else 0)


def test_the_note_gives_the_width_of_the_bounds_if_it_is_known(tmp_path, drawn):
    drawn_from("infsup", tmp_path)
    drawn_from("infsup", tmp_path, infsup=infsup_table().assign(widest=0.0123))
    without, with_width = ([text.get_text() for text in texts(page)] for page, _ in drawn)
    assert any("at most 1.2 % higher" in text for text in with_width)
    assert not any("%" in text for text in without)
