"""The figure of the inf-sup constant: the numbers of its table, and only those."""

import numpy as np
import pytest
from pages import draw_page, list_texts, page, pairs, points, table

from study.experiments.stability.infsup_figure import MAX_REGULAR_ALPHA_1
from unilateral.norms.resolution import RULE


def test_beta_stands_over_the_ratio_and_over_delta_and_below_it_the_bound_without_eigenvalues():
    """Lower bounds of all pairs, and the bound where there is one; besides them lines, and no point else."""
    rows = table("infsup")
    ratio, inner, unsolved = page("infsup")[0].axes
    ratio_pairs = pairs(rows, "h_over_H", "beta_lower")
    line = {(1, 0), (1, 1)}
    assert points(ratio) | line == ratio_pairs | line
    curve = {(x, y) for x, y in points(inner) if abs(y - x * (1 - x)) < 1e-8}
    assert len(curve) >= 50
    assert points(inner) - curve == pairs(rows, "delta", "beta_lower") - curve
    lines = {(0, 0), (1, 1), (1, 0.25)}
    known_rows = rows[rows["beta_fortin"] > 0]
    assert points(unsolved) | lines == pairs(known_rows, "beta_lower", "beta_fortin") | lines


def test_the_looks_are_those_of_the_claims():
    """Filled where angles and ratios of cells are those of claim T.node, open elsewhere; others by kind."""
    rows = table("infsup")
    retained = (rows["smallest_angle"] >= RULE.smallest_angle) & (rows["alpha_1"] <= MAX_REGULAR_ALPHA_1)
    local = rows["kind"] == "local"
    drawn_as = {
        line.get_marker() + str(line.get_markerfacecolor()): len(line.get_xdata())
        for line in page("infsup")[0].axes[0].lines
        if len(line.get_xdata()) > 2
    }
    counts = sorted([(~local & (rows["kind"] == kind)).sum() for kind in ("uniform", "worst")])
    assert drawn_as["owhite"] == np.sum(local & ~retained)
    assert drawn_as["o0.25"] == np.sum(local & retained)
    assert sorted(n for look, n in drawn_as.items() if look[0] in "sx") == counts


@pytest.mark.parametrize("expected", [True, False])
def test_the_note_gives_the_width_of_the_bounds_if_it_is_known(expected):
    rows = table("infsup")
    figure, _ = draw_page("infsup", rows.assign(widest=0.0123) if expected else rows.drop(columns="widest"))
    texts = list_texts(figure)
    assert any("at most 1.3 % higher" in text for text in texts) == expected
    assert any("%" in text for text in texts) == expected
