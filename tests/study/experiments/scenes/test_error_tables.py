"""Tables of rates, floors and of beta, as documents show them: by hand."""

import numpy as np
import pandas as pd
import xarray as xr

from study.documents import numbers
from study.experiments.scenes import numbers as scenes
from study.experiments.sharpness import numbers as sharpness
from study.experiments.stability import numbers as stability


def made_up():
    """Two cases at h/H = 1/2, three pairs of which the last two count."""
    index = ("case", "norm", "h_over_H")
    rate = np.full((2, 3, 1, 3), [0.5, 1.125, 0.997])
    rate[1, 0] = [2.0, 0.9, 1.0]
    asymptotic = np.broadcast_to([0.0, 1.0, 1.0], rate.shape)
    verdict = [[["holds"], ["holds"], ["holds"]], [["fails"], ["exact"], ["not judged"]]]
    return xr.Dataset(
        {
            "rate": ((*index, "pair"), rate),
            "asymptotic": ((*index, "pair"), asymptotic),
            "proved": (index, np.broadcast_to([[[1.0], [1.0], [0.5]]], (2, 3, 1))),
            "expected": (index, np.broadcast_to([[[1.0], [1.5], [1.0]]], (2, 3, 1))),
            "verdict": (index, np.array(verdict, dtype=object)),
        },
        coords={"case": ["first", "second"], "norm": ["h1", "hm12", "l2"], "h_over_H": [0.5]},
    )


def test_the_table_of_rates_has_each_observed_rate_beside_the_expected_one():
    table = scenes.tabulate_rates({"square": made_up(), "again": made_up().isel(case=[0])}, 0.5)
    heads = [
        "$u$ in $H^1$ (proved 1)",
        r"$\lambda$ in $H^{-1/2}$ (proved 1)",
        r"$\lambda$ in $L^2$ (proved 0.5)",
    ]
    assert list(table) == ["scene", "case", *heads]
    first = ["`first`", "1.00 of 1 (2 pairs)", "1.00 of 1.5 (2 pairs)", "1.00 of 1 (2 pairs)"]
    second = ["`second`", "0.90 of 1 (2 pairs), **fails**", "error 0, as exact", "not judged"]
    assert table.values.tolist() == [["square", *first], ["square", *second], ["again", *first]]


def test_the_rates_of_a_case_are_the_smallest_of_its_scenes():
    """By hand: in the second scene the last pair has 0.75. A case that is not judged is left out.

    A star marks the rate that no theorem proves on a scene of the row; the other scene is not there.
    """
    unproved = {"h1": {}, "hm12": {"unproved": ["again"]}, "l2": {"unproved": ["elsewhere"]}}
    expectations = {"first": unproved, "second": unproved}
    other_row = made_up().isel(case=[0])
    other_row["rate"][0, :, 0, 2] = 0.75
    table = scenes.tabulate_rates_by_case({"square": made_up(), "again": other_row}, 0.5, expectations)
    first = ["`first`", "square, again", "0.75 of 1", r"0.75 of 1.5\*", "0.75 of 1"]
    assert table.values.tolist() == [first, ["`second`", "square", "0.90 of 1, **fails**", "exact", "–"]]
    unknown = made_up().isel(case=[0])
    unknown["verdict"][:] = "not judged"
    assert scenes.tabulate_rates_by_case({"square": unknown}, 0.5, expectations).empty


def made_up_pairs():
    """Two families at H/h = 2 and 4, and three other pairs, two of them with flat triangles."""
    rows = [
        ["square", "uniform", 0.5, 2.0, 2.0, 45.0, 0.7349, 0.74],
        ["square", "uniform", 0.25, 4.0, 4.0, 45.0, 0.92, 0.93],
        ["gmsh", "uniform", 0.5, 2.0, 2.0, 40.0, 0.77, 0.78],
        ["gmsh", "uniform", 0.25, 4.0, 4.0, 40.0, 0.9571, 0.96],
        ["graded", "local", 0.5, 2.0, 2.0, 10.0, 0.5, 0.508],
        ["random", "local", 0.7, 3.0, 1.5, 25.0, 0.8, 0.81],
        ["found", "worst", 0.6, 2.0, 1.0, 1.14, 0.18, 0.187],
    ]
    columns = ["label", "kind", "h_over_H", "edges_per_cell", "cell_over_edge", "smallest_angle"]
    return pd.DataFrame(rows, columns=[*columns, "beta_lower", "beta_upper"])


def test_lower_bounds_of_beta_are_rounded_down():
    table = stability.tabulate_least_beta(made_up_pairs(), [2, 4])
    assert list(table) == [r"$\beta$ at least, at $H/h$ =", "2", "4"]
    assert table.values.tolist() == [["square", "0.73", "0.92"], ["gmsh", "0.77", "0.95"]]


def test_the_rule_for_beta_counts_the_pairs_that_keep_it():
    """By hand: four pairs keep it."""
    flatten_groups = numbers.flatten_groups(stability.summarise_rule(made_up_pairs(), 2, 20))
    assert flatten_groups["kept"] == 4
    assert (flatten_groups["flat.beta"], flatten_groups["flat.mesh"]) == (0.508, "graded")
    assert flatten_groups["edges.angle"] == 1.14


def test_the_rule_follows_its_parameters():
    """Control."""
    assert stability.summarise_rule(made_up_pairs(), 2, 42)["kept"] == 2


def test_correlations_with_beta_are_those_of_ranks():
    """By hand: the ranks of h/H, of the edges and of H_i/edge against those of beta."""
    table = stability.tabulate_correlations(made_up_pairs(), 20)
    assert table.values.tolist()[0] == ["3 pairs that are not uniform", "0.50", "0.87", "0.50"]
    assert table.iloc[1, 0] == "1 of them without angles below 20°"


def test_exceptions_are_named_with_what_they_lack():
    """By hand: of four places one misses its rate, and one without alpha > 0 does not count."""
    rate = np.array([[[1.0, 1.3]], [[1.5, 1.5]]])  # (alpha, pair, gamma)
    rates = xr.Dataset(
        {
            "predicted": (("norm", "alpha"), [[1.5, 1.5]]),
            "rate": (("norm", "pair", "alpha", "gamma"), rate.swapaxes(0, 1)[None]),
        },
        coords={
            "norm": ["hm12"],
            "alpha": [-0.25, 0.5],
            "gamma": [1.0, 2.0],
            "H": ("level", [1, 1 / 2, 1 / 4]),
        },
    )
    rates["held"] = (("level", "alpha", "gamma"), [2 * [[0.5, 0.5]], 2 * [[0.5, 0.5]], 2 * [[0.125, 0.5]]])
    assert sharpness.tabulate_exceptions(rates, {"hm12": 0.1}).values.tolist() == []
    rates["rate"][0, -1, 1, 0] = 1.25
    table = sharpness.tabulate_exceptions(rates, {"hm12": 0.1})
    lacks = 0.25 - 0.5 * np.log2((1 + np.log(4)) / (1 + np.log(2)))
    assert list(table) == [r"$\alpha$", r"$\gamma$", r"$\lambda$ in $H^{-1/2}$", sharpness.POSITIONS_TITLE]
    assert table.values.tolist() == [["0.5", "1", f"0.25 ({lacks:.2f})", "12.5 %"]]


def test_the_table_of_floors_has_constants_with_their_uncertainty():
    values = {"C1": 1.234, "C2": 0.5, "s": 1.5, "s_uncertainty": 0.01, "residual": 0.0123, "pairs": 7}
    fits = xr.Dataset(
        {name: ("case", [value]) for name, value in values.items()}, coords={"case": ["natural"]}
    )
    assert scenes.tabulate_floors(fits).values.tolist() == [
        ["`natural`", "1.23", "0.5", "1.50 ± 0.01", "7", "1.2 %"]
    ]


def test_the_table_of_errors_in_L2_has_the_largest_order_and_both_ends_of_the_rates():
    """By hand: the rates 2 and 1, on the pairs that count; a case without such pairs has no row.

    The second case has a D that its algebraic bound hides.
    """
    sizes = [1.0, 0.5, 0.25, 0.125]
    errors = xr.Dataset(
        {
            "u_l2_error": (("case", "mesh"), 3 * [[9.0, 4.0, 1.0, 0.5]]),
            "discrete_error": (("case", "mesh"), 3 * [[9.0, 9.0, 9.0, 4.0]]),
            "algebraic_bound": (("case", "mesh"), [4 * [0.0], 4 * [5.0], 4 * [0.0]]),
        },
        coords={"case": ["first", "second", "third"], "h": ("mesh", sizes)},
    )
    index = ("case", "norm", "h_over_H", "pair")
    asymptotic = np.array([[0.0, 1.0, 1.0], [0.0, 1.0, 1.0], [0.0, 0.0, 0.0]])
    pairs = {"asymptotic": asymptotic, "h_coarse": sizes[:-1], "h_fine": sizes[1:]}
    rates = xr.Dataset(
        {name: (index, np.broadcast_to(value, (3, 3))[:, None, None]) for name, value in pairs.items()},
        coords={"case": ["first", "second", "third"], "norm": ["hm12"], "h_over_H": [0.5]},
    )
    claimed = [
        {"scenes": ["square"], "orders": {"first": 1.5, "second": 1.1}},
        {"scenes": ["square"], "orders": {"first": 2}},
    ]
    tables = {"square": errors, "lshape": errors.isel(case=[0])}
    table = scenes.tabulate_u_in_l2(tables, {"square": rates, "lshape": rates}, 0.5, claimed)
    assert table.values.tolist() == [
        ["square", "`first`", "2", "1.00 to 2.00 (2 pairs)", "8"],
        ["square", "`second`", "1.1", "1.00 to 2.00 (2 pairs)", "0"],
        ["lshape", "`first`", "–", "1.00 to 2.00 (2 pairs)", "8"],
    ]


def test_the_table_of_fixed_cells_has_D_over_h_and_the_distance():
    """At H = 1/8 below h = H; a case whose lambda lies in P0 is left out."""
    D = np.array([[[7.0, 7.0], [7.0, 0.25], [7.0, 0.5]]] * 2)
    errors = xr.Dataset(
        {
            "discrete_error": (("case", "mesh", "partition"), D),
            "hm12_best": (("case", "mesh", "partition"), 0.1 * D * [[[1]], [[0]]]),
            "u_norm": (("case", "mesh"), np.ones((2, 3))),
        },
        coords={
            "case": ["first", "exact"],
            "h": ("mesh", [1 / 8, 1 / 16, 1 / 32]),
            "H": ("partition", [1 / 4, 1 / 8]),
        },
    )
    table = scenes.tabulate_fixed_cells(errors)
    assert list(table) == ["case", "h = 1/16", "h = 1/32", r"distance of $\lambda$"]
    assert table.values.tolist() == [["`first`", "0.25", "0.5", "0.05"]]


def test_nodes_in_the_middle_of_cells_are_told_apart_from_others():
    """By hand: of the pairs at h = H two have delta = 1/2 and equal cells."""
    columns = ["h_over_H", "delta", "alpha_1", "beta_lower"]
    rows = [
        [1.0, 0.5, 1.0, 0.7],
        [1.0, 0.5, 1.0, 0.6],
        [1.0, 0.25, 1.0, 0.3],
        [1.0, 0.5, 3.0, 0.2],
        [0.5, 0.5, 1.0, 0.1],
    ]
    assert stability.summarise_inner_nodes(pd.DataFrame(rows, columns=columns)) == {"pairs": 5, "middle": 0.6}


def test_what_is_told_of_theorems_comes_from_their_claims():
    assert sharpness.summarise_theorems({"T.H": -0.03, "T.D": 0.75}) == {"deficit": 0.03, "slack": 0.25}
    assert sharpness.summarise_theorems({"T.H": 0.03, "T.D": 0.75})["deficit"] == 0
