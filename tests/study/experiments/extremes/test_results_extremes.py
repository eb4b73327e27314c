"""The stored extremes: complete, never wrong, and where theory says. Nothing is solved here."""

import math

import numpy as np
import pytest
from conftest import RESULTS, ROOT, config
from conftest import read_stored_table as table_of

from study.documents import marks, numbers
from study.experiments.extremes import extremes_figure as figure
from study.experiments.extremes import measure as extremes
from study.experiments.extremes import numbers as extremes_tables
from study.experiments.extremes import problem, reaction
from study.ledger import claims
from unilateral.formulas.formula import parse_real

STUDY = config("extremes")["extremes"]
AXES = STUDY["axes"]
EVERYWHERE = [
    *("ratio", "odd", "shift", "short", "near", "kernel", "kernel_loaded", "flat"),
    *("touching", "shrinking", "vertex", "nothing", "scale_up"),
]
VARIANTS = ["step_full", "step_partial", "printed_full", "printed_partial", "single", "double"]
"""What the library does not offer, or takes as it is given."""
REFUSALS = (
    "clamp a side",
    "scale the data",
    "move polygon",
    "list every node once",
    "repeats",
    "finite numbers",
)
LAWS = {"shift": -2, "short": -1, "short_loaded": -1, "odd": 3, "slit": -1, "side": -1, "angle": -2}


def read_survey():
    return table_of("extremes/extremes")


def select_axis(axis):
    return read_survey().isel(point=read_survey()["axis_of"].values == axis).sel(axis=axis)


def numbers_of(axis, *names):
    return (select_axis(axis)[name].values for name in names)


def test_the_table_is_complete():
    assert set(read_survey()["axis"].values) == set(AXES)
    for name, axis in AXES.items():
        values = [extremes.read_value(value, name) for value in axis["values"]]
        np.testing.assert_allclose(select_axis(name)["value"], values, rtol=1e-15)
        assert str(select_axis(name)["label"].item()) == axis["label"]


def test_what_is_refused_says_why():
    messages = read_survey()["message"].values[read_survey()["outcome"].values == "refused"]
    assert len(messages)
    assert all(any(word in message for word in REFUSALS) for message in messages)


@pytest.mark.parametrize("axis", AXES)
def test_a_tool_is_never_worse_than_plain_uzawa(axis):
    """None is told of where rho is given. Where S is singular an active set finds u_h."""
    plain, tool = numbers_of(axis, "outcome", "tool")
    if axis in VARIANTS:
        assert set(tool) == {""}
        assert math.isnan(select_axis(axis)["measured_tool_limit"].item())
        return
    assert np.all((plain != "right") | (tool == "right"))
    assert set(tool) <= ({"right"} if axis in EVERYWHERE else {"right", "not converged", "refused"})


def test_what_bounds_are_allowed_is_small():
    """At most a tenth of the bound or of the tolerance, whichever is larger, may be rounding.

    What is printed of it is twice as large, and needed: a hundredth of it would be too small.
    """
    survey = read_survey()
    error = survey["true_error"].values
    bound = survey["guaranteed"].values
    allowance = survey["allowance"].values
    tolerance = survey["tolerance"].values
    u_norm = survey["u_norm"].values
    tried = np.isfinite(error)
    solved = u_norm > 0
    printed = outcomes()["allowed"]
    assert np.all(allowance[tried] <= 0.1 * np.maximum(bound, tolerance)[tried])
    assert np.all(select_axis("moved")["allowance"].values[:6] < 1e-10)
    assert 2 <= printed / np.max(allowance[solved] / u_norm[solved]) <= 100
    assert np.any(error > bound)
    assert np.all(error[tried] <= (bound + printed * u_norm)[tried])


def test_the_tolerance_is_that_of_the_axis():
    """Relative to what 0 is off: half to three halves of ||1||_{-1/2} / 4 where lambda_H is in [1/8, 3/8]."""
    exact_value = math.sqrt(8 + 4 / math.tanh(0.5)) / 4
    for name in ("step_full", "single"):
        accuracy = AXES[name].get("accuracy", STUDY["accuracy"])
        share = select_axis(name)["tolerance"].values / accuracy / exact_value
        assert np.all((share > 0.5) & (share < 1.5))


def test_data_and_starts_are_right_up_to_their_limits_and_refused_beyond():
    """Values on both sides of the limit, less than a factor of 10 from it."""
    for name, factor in (("data_up", 10), ("start", 1.1)):
        outcome = select_axis(name)["outcome"].values
        value = select_axis(name)["value"]
        limit = select_axis(name)["predicted_limit"]
        np.testing.assert_array_equal(outcome, np.where(value < limit, "right", "refused"))
        assert limit / factor < value[value < limit].max()
        assert value[value > limit].min() < limit * factor
    assert set(select_axis("data_down")["outcome"].values) == {"right", "refused"}
    assert (
        select_axis("data_down")["measured_limit"]
        < np.finfo(float).tiny
        < select_axis("data_down")["predicted_limit"]
    )


def test_short_cells_hardly_matter_from_0_and_do_from_a_start_that_loads_them():
    """Then plain Uzawa fails wherever it does from 0, and the tool does where S is just regular."""
    plain = select_axis("short")["outcome"].values == "right"
    harder = select_axis("short_loaded")["outcome"].values == "right"
    assert np.all(plain | ~harder)
    assert np.count_nonzero(plain) > np.count_nonzero(harder) > 0
    tool, measured, bound, tolerance = numbers_of(
        "short_loaded", "tool", "measured", "guaranteed", "tolerance"
    )
    failed = tool != "right"
    assert set(tool[failed]) == {"not converged"}
    assert np.isfinite(measured[failed]).all()
    assert np.all(bound[failed] > 1e3 * tolerance[failed])


def test_beta_is_0_from_h_equal_to_H_on():
    table = select_axis("ratio")
    np.testing.assert_array_equal(np.isinf(table["measured"]), table["value"] >= 1)


@pytest.mark.parametrize(("axis", "exponent"), LAWS.items())
def test_condition_numbers_follow_their_laws(axis, exponent):
    """Over the last finite values; a tenth either way for what is not yet asymptotic.

    At an angle a area and shortest side are both like a.
    """
    value, number = numbers_of(axis, "value", "measured")
    last = np.flatnonzero(np.isfinite(number))[-3:]
    slope = np.polyfit(np.log(value[last]), np.log(number[last]), 1)[0]
    assert slope == pytest.approx(exponent, abs=0.1)


@pytest.mark.parametrize("axis", extremes_tables.CONDITION_AXES)
def test_condition_numbers_are_hardly_above_what_is_predicted_of_them(axis):
    """2.5 times at most, for the law is that of lower bounds of lambda_max and of the shortest cell."""
    measured, predicted = numbers_of(axis, "measured", "predicted")
    share = measured / predicted
    assert np.count_nonzero(np.isfinite(share)) > (axis != "scale_up")
    assert np.nanmax(share[np.isfinite(share)]) <= 2.5
    if axis == "scale_up":  # where numbers below 1 would be predicted, none is
        assert predicted[0] >= 1
        assert np.isnan(predicted[1:]).all()


def test_flat_triangles_leave_the_condition_number_alone():
    """The regular family of the paper is not needed for it: no angle is near 180 degrees."""
    number = select_axis("aspect")["measured"].values
    finite = number[np.isfinite(number)]
    assert len(finite) >= 4
    assert finite.max() < 1.1 * finite.min()


def test_cells_off_mesh_vertices_change_the_operator_by_their_distance():
    measured, predicted = numbers_of("near", "measured", "predicted")
    assert np.all((measured / predicted > 0.1) & (measured / predicted < 1.1))


def test_one_multiplier_may_be_far_from_smooth_and_two_may_differ():
    """O(1), relative, for a gap that goes to 0; and with g orthogonal to the kernel another one is found."""
    measured, predicted = numbers_of("kernel_loaded", "measured", "predicted")
    np.testing.assert_allclose(measured, predicted, rtol=1e-9)
    assert np.all(measured > 0.8)
    assert np.isinf(
        [select_axis(axis)["predicted_limit"].item() for axis in ("kernel", "kernel_loaded")]
    ).all()
    assert np.all(select_axis("kernel")["measured"] > 0.1)


def test_contact_is_lost_where_its_mean_is_and_seen_by_no_mean_in_a_point():
    """pi^2 H^2/72 to leading order: the next term is of the relative order H^2."""
    np.testing.assert_array_equal(*numbers_of("shrinking", "measured", "predicted"))
    table = select_axis("touching")
    share = table["measured"].values / table["predicted"].values
    assert np.all(np.abs(share - 1) < table["value"].values ** 2 / 10)
    assert all(int(message.split()[0]) > 1 for message in table["message"].values)


def test_larger_steps_may_do_in_partial_contact_but_not_up_to_the_local_limit():
    table = select_axis("step_partial")
    right = table["outcome"].values == "right"
    assert right[table["value"].values <= 1.8].all()
    assert not right[table["value"].values >= table["local_limit"].item()].any()
    assert table["measured_limit"].item() < table["local_limit"].item()


@pytest.mark.parametrize(
    ("axis", "limit"), [("step_full", 1), ("printed_full", 0.5), ("printed_partial", 0.5)]
)
def test_a_bounded_cycle_is_left_above_the_limit(axis, limit):
    """The clip keeps every iterate within a few times the solution."""
    value, measured, outcome = numbers_of(axis, "value", "measured", "outcome")
    assert np.all(outcome[value < limit] == "right")
    assert np.all(measured < 10)
    if axis == "step_full":
        assert np.all(measured[value > 1] > 0.1)
        assert np.all(measured[value <= 1] < 1e-12)


def test_single_precision_stops_where_double_goes_on():
    """And no bound that is rounding is near its tolerance, or else the CPU would decide."""
    assert np.all(select_axis("single")["measured"].values > 1e6 * select_axis("double")["measured"].values)
    assert set(select_axis("double")["outcome"].values) == {"right"}
    measured, predicted = numbers_of("double", "measured", "predicted")
    assert np.all((measured / predicted > 0.1) & (measured / predicted < 10))
    for name in ("single", "double"):
        bound, tolerance, outcome = numbers_of(name, "guaranteed", "tolerance", "outcome")
        assert not np.any((bound > tolerance / 3) & (bound < 3 * tolerance))
        assert set(outcome[bound > tolerance]) <= {"not converged"}
    assert select_axis("single")["measured_limit"].item() == 1 / 32


def test_the_figure_s_rows_are_the_points():
    frame = figure.table(RESULTS / "extremes/extremes.nc")
    assert len(frame) == read_survey().sizes["point"]
    np.testing.assert_allclose(10 ** frame["log10_value"], read_survey()["value"], rtol=1e-12)
    rescued = (read_survey()["outcome"].values != "right") & (read_survey()["tool"].values == "right")
    np.testing.assert_array_equal(frame["kind"] == extremes_tables.RESCUED, rescued)


def outcomes():
    return numbers.flatten_groups(extremes_tables.summarise_outcomes(read_survey()))


def test_every_axis_is_in_one_of_two_tables_and_every_point_counted_once():
    """In the second those without limits, on which all is right."""
    limited = extremes_tables.tabulate_limits(read_survey())
    other_unlimited_axes = extremes_tables.tabulate_unlimited_axes(read_survey())
    labels = {axis["label"] for axis in AXES.values()}
    assert sorted([*limited["axis"], *other_unlimited_axes["axis"]]) == sorted(labels)
    for name in AXES:
        label = select_axis(name)["label"].item()
        right = set(select_axis(name)["outcome"].values) == {"right"}
        limits = [select_axis(name)[limit].item() for limit in ("predicted_limit", "predicted_tool_limit")]
        assert (label in list(other_unlimited_axes["axis"])) == (right and bool(np.isnan(limits).all()))
    assert (limited["limit of `unilateral solve`: predicted, met at"] == "not offered").sum() == len(
        VARIANTS
    ) - 1
    numbers_by_name = outcomes()
    assert numbers_by_name["axes.unlimited"] == len(other_unlimited_axes)
    kinds = ("right", "by_tool", "not_converged", "refused", "wrong")
    assert (
        sum(numbers_by_name[kind] for kind in kinds)
        == numbers_by_name["points"]
        == read_survey().sizes["point"]
    )


def test_the_page_on_extremes_names_every_axis_that_has_settings_of_its_own():
    text = marks.remove_marks((ROOT / "docs/extremes.md").read_text(encoding="utf-8"))
    original = [name for name, axis in AXES.items() if {"h", "H", "accuracy"} & set(axis)]
    assert len(original) == 3
    assert "Three axes have settings of their own." in text
    for axis in original:
        assert f"For *{AXES[axis]['label']}* " in text
    assert f"but at least $10^{{{math.log10(problem.MIN_ROUNDING):.0f}}}$, times" in text


def read_reaction_survey():
    return table_of("extremes/reaction")


def test_the_table_over_c_is_complete_and_has_a_bound_everywhere():
    declared = STUDY["reaction"]
    assert read_reaction_survey()["c_over_k"].values.tolist() == [0, *declared["c_over_k"]]
    assert read_reaction_survey()["h"].values.tolist() == [parse_real(h, "") for h in declared["h"]]
    assert read_reaction_survey()["case"].values.tolist() == list(reaction.REACTION_CASES)
    assert set(read_reaction_survey()["message"].values.ravel()) == {""}


def test_errors_over_c_halve_with_h_where_the_mesh_resolves_u():
    """Up to c/k = 1, within a tenth for terms of higher order."""
    error = read_reaction_survey()["energy_error"].sel(c_over_k=slice(0, 1)).values
    np.testing.assert_allclose(error[:, :-1] / error[:, 1:], 2, rtol=0.1)


def test_what_is_said_of_bounds_over_c_is_in_the_table():
    """Every number by a loop over all points."""
    summarise_reaction = extremes_tables.summarise_reaction(read_reaction_survey())
    points = read_reaction_survey().stack(point=("case", "mesh", "c_over_k"))
    rows = [points.isel(point=i) for i in range(points.sizes["point"])]
    for bound in ("cheap", "sharp"):
        assert summarise_reaction[bound] == max(
            (row[f"{bound}_bound"] / row["energy_error"]).item() for row in rows
        )
    assert (summarise_reaction["points"], summarise_reaction["failed"]) == (len(rows), 0)
    assert (summarise_reaction["from"], summarise_reaction["to"]) == (1e-30, 1e16)
    assert (summarise_reaction["coarsest"], summarise_reaction["finest"]) == (1 / 8, 1 / 32)
    # f = c + 1 in the boundary layers, which changes u by 1 % for c = 0.01
    tiny = claims.find_claim("X.tiny").measure({"extremes/reaction": read_reaction_survey()}).observed
    assert tiny <= summarise_reaction["slight"] <= 0.02
