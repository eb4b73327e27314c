"""The figure of the dual norm: the numbers of its table, and only those."""

from pages import page, pairs, points, table


def test_norms_gaps_and_shortcuts_are_those_of_the_table():
    """The shortcut stands beside the norm of both functions and of the first two cases."""
    rows = table("dual_norm")
    errors, gaps, norms = page("dual_norm")[0].axes
    cases = rows["case"].dropna().unique().tolist()
    compared = rows[~rows["case"].isin(cases[2:])]
    assert len(compared) < len(rows)
    assert points(errors) == pairs(rows[rows["kind"] == "error"], "H", "mean")
    assert points(gaps) == pairs(rows, "H", "gap")
    assert points(norms) == pairs(compared, "H", "mean") | pairs(compared, "H", "shortcut")
