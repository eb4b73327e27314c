"""The figure of the dual norm: the numbers of its table, and only those."""

from examples import drawn_from, dual_norm_table, pairs, points


def test_norms_gaps_and_shortcuts_are_those_of_the_table(tmp_path, drawn):
    """The shortcut stands beside the norm of both functions and of the first two cases."""
    drawn_from("dual_norm", tmp_path)
    errors, gaps, norms = drawn[0][0].axes
    table = dual_norm_table()
    assert points(errors) == pairs(table[table["kind"] == "error"], "H", "mean")
    assert points(gaps) == pairs(table, "H", "gap")
    compared = table[table["case"] != "smooth"]
    assert points(norms) == pairs(compared, "H", "mean") | pairs(compared, "H", "shortcut")
    assert points(gaps) != pairs(table.assign(gap=table["upper"] / table["lower"] - 1), "H", "gap")
