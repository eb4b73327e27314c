"""The stored extremes: complete, never wrong, and where theory says. Nothing is solved here."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
import pytest
import xarray as xr
import yaml
from conftest import ROOT

from unilateral.study import tables
from unilateral.study.figures import extremes as figure
from unilateral.study.judge.extremes import RESCUED
from unilateral.study.runs import extremes
from unilateral.study.runs.extremes import problem
from unilateral.study.text import extremes_tables, marks, numbers

CONFIG = yaml.safe_load((ROOT / "workflow/config/extremes.yaml").read_text())
STUDY = CONFIG["extremes"]
AXES = STUDY["axes"]
EVERYWHERE = [
    *("ratio", "odd", "shift", "short", "near", "kernel", "kernel_loaded", "flat"),
    *("touching", "shrinking", "vertex", "nothing", "scale_up"),
]
VARIANTS = ["step_full", "step_partial", "printed_full", "printed_partial", "single", "double"]
"""What the library does not offer, or takes as it is given."""
REFUSALS = ("scale it", "scale the data", "move polygon", "list every node once", "repeats", "finite numbers")
LAWS = {"shift": -2, "short": -1, "short_loaded": -1, "odd": 3, "slit": -1, "side": -1, "angle": -2}


@cache
def stored() -> xr.Dataset:
    return tables.load(ROOT / "results/extremes/extremes.nc")


def of(axis: str) -> xr.Dataset:
    return stored().isel(point=stored()["axis_of"].values == axis).sel(axis=axis)


def test_the_table_is_complete() -> None:
    assert set(stored()["axis"].values) == set(AXES)
    for name, axis in AXES.items():
        np.testing.assert_allclose(
            of(name)["value"], [extremes._value(value, name) for value in axis["values"]], rtol=1e-15
        )
        assert str(of(name)["label"].item()) == axis["label"]
    assert [name for name in stored().variables if not stored()[name].attrs.get("units")] in ([], ["axis"])


def test_nothing_is_wrong_and_what_is_refused_says_why() -> None:
    table = stored()
    assert set(table["outcome"].values) == {"right", "not converged", "refused"}
    assert set(table["tool"].values) == {"right", "not converged", "refused", ""}
    messages = table["message"].values[table["outcome"].values == "refused"]
    assert len(messages)
    for message in messages:
        assert any(word in message for word in REFUSALS)


@pytest.mark.parametrize("axis", sorted(set(AXES) - set(VARIANTS)))
def test_a_tool_is_never_worse_than_plain_uzawa(axis: str) -> None:
    plain, tool = of(axis)["outcome"].values, of(axis)["tool"].values
    assert np.all((plain != "right") | (tool == "right"))
    assert "" not in tool


def test_no_tool_is_told_of_where_rho_is_given() -> None:
    for axis in VARIANTS:
        assert set(of(axis)["tool"].values) == {""}
        assert math.isnan(of(axis)["measured_tool_limit"].item())
    tool = extremes_tables.limits(stored())["limit of the tool: predicted, met at"]
    assert (tool == "no tool").sum() == len(VARIANTS) - 1


def values(*names: str) -> list[np.ndarray]:
    return [stored()[name].values for name in names]


def test_what_bounds_are_allowed_is_small() -> None:
    """At most a tenth of the bound or of the tolerance, whichever is larger, may be rounding."""
    error, bound, allowance, tolerance = values("true_error", "guaranteed", "allowance", "tolerance")
    tried = np.isfinite(error)
    assert np.all(allowance[tried] <= 0.1 * np.maximum(bound, tolerance)[tried])
    assert np.all(of("moved")["allowance"].values[:6] < 1e-10)


def test_the_tolerance_is_that_of_the_axis() -> None:
    """Relative to what 0 is off: half to three halves of ||1||_{-1/2} / 4 where lambda_H is in [1/8, 3/8]."""
    of_one = math.sqrt(8 + 4 / math.tanh(0.5)) / 4
    for name in ("step_full", "single"):
        accuracy = AXES[name].get("accuracy", STUDY["accuracy"])
        share = of(name)["tolerance"].values / accuracy / of_one
        assert np.all((share > 0.5) & (share < 1.5))


def test_data_and_starts_are_right_up_to_their_limits_and_refused_beyond() -> None:
    """Values on both sides of the limit, less than a factor of 10 from it."""
    for name, factor in (("data_up", 10), ("start", 1.1)):
        outcome, value, limit = of(name)["outcome"].values, of(name)["value"], of(name)["predicted_limit"]
        np.testing.assert_array_equal(outcome, np.where(value < limit, "right", "refused"))
        assert limit / factor < value[value < limit].max()
        assert value[value > limit].min() < limit * factor
    assert set(of("data_down")["outcome"].values) == {"right", "refused"}
    assert of("data_down")["measured_limit"] < np.finfo(float).tiny < of("data_down")["predicted_limit"]


def test_short_cells_hardly_matter_from_0_and_do_from_a_start_that_loads_them() -> None:
    """Then plain Uzawa fails wherever it does from 0, and the tool does where S is just regular."""
    ours, loaded = of("short"), of("short_loaded")
    plain, harder = (table["outcome"].values == "right" for table in (ours, loaded))
    assert np.all(plain | ~harder)
    assert np.count_nonzero(plain) > np.count_nonzero(harder) > 0
    assert set(ours["tool"].values) == {"right"}
    failed = loaded["tool"].values != "right"
    assert set(loaded["tool"].values[failed]) == {"not converged"}
    assert np.isfinite(loaded["measured"].values[failed]).all()
    assert np.all(loaded["guaranteed"].values[failed] > 1e3 * loaded["tolerance"].values[failed])


def test_no_condition_number_below_1_is_predicted() -> None:
    assert not np.any(of("scale_up")["predicted"].values < 1)
    assert np.isnan(of("scale_up")["predicted"].values[1:]).all()


@pytest.mark.parametrize("axis", EVERYWHERE)
def test_the_tool_is_right_everywhere(axis: str) -> None:
    """Where S is singular an active set finds u_h; elsewhere Nesterov has steps enough."""
    assert set(of(axis)["tool"].values) == {"right"}


def test_beta_is_0_from_h_equal_to_H_on() -> None:
    table = of("ratio")
    np.testing.assert_array_equal(np.isinf(table["measured"]), table["value"] >= 1)


@pytest.mark.parametrize(("axis", "exponent"), LAWS.items())
def test_condition_numbers_follow_their_laws(axis: str, exponent: float) -> None:
    """Over the last finite values; a tenth either way for what is not yet asymptotic.

    At an angle a area and shortest side are both like a.
    """
    value, number = of(axis)["value"].values, of(axis)["measured"].values
    last = np.flatnonzero(np.isfinite(number))[-3:]
    slope = np.polyfit(np.log(value[last]), np.log(number[last]), 1)[0]
    assert slope == pytest.approx(exponent, abs=0.1)


@pytest.mark.parametrize("axis", numbers.LAWS)
def test_condition_numbers_are_hardly_above_what_is_predicted_of_them(axis: str) -> None:
    """2.5 times at most, for the law is that of lower bounds of lambda_max and of the shortest cell."""
    share = (of(axis)["measured"] / of(axis)["predicted"]).values
    assert np.count_nonzero(np.isfinite(share)) > (axis != "scale_up")
    assert np.nanmax(share[np.isfinite(share)]) <= 2.5


def test_flat_triangles_leave_the_condition_number_alone() -> None:
    """The regular family of the paper is not needed for it: no angle is near 180 degrees."""
    number = of("aspect")["measured"].values
    finite = number[np.isfinite(number)]
    assert len(finite) >= 4
    assert finite.max() < 1.1 * finite.min()


def test_cells_off_mesh_vertices_change_the_operator_by_their_distance() -> None:
    table = of("near")
    share = table["measured"].values / table["predicted"].values
    assert np.all((share > 0.1) & (share < 1.1))


def test_contact_is_lost_where_its_mean_is() -> None:
    np.testing.assert_array_equal(of("shrinking")["measured"], of("shrinking")["predicted"])


def test_one_multiplier_may_be_far_from_smooth_and_two_may_differ() -> None:
    """O(1), relative, for a gap that goes to 0; and with g orthogonal to the kernel another one is found."""
    table = of("kernel_loaded")
    np.testing.assert_allclose(table["measured"], table["predicted"], rtol=1e-9)
    assert np.all(table["measured"] > 0.8)
    assert np.isinf([of(axis)["predicted_limit"].item() for axis in ("kernel", "kernel_loaded")]).all()
    assert np.all(of("kernel")["measured"] > 0.1)


def test_contact_in_a_point_is_seen_by_no_mean() -> None:
    """pi^2 H^2/72 to leading order: the next term is of the relative order H^2."""
    table = of("touching")
    share = table["measured"].values / table["predicted"].values
    assert np.all(np.abs(share - 1) < table["value"].values ** 2 / 10)
    assert all(int(said.split()[0]) > 1 for said in table["message"].values)


def test_larger_steps_may_do_in_partial_contact_but_not_up_to_the_local_limit() -> None:
    table = of("step_partial")
    right = table["outcome"].values == "right"
    assert right[table["value"].values <= 1.8].all()
    assert not right[table["value"].values >= table["local_limit"].item()].any()
    assert table["measured_limit"].item() < table["local_limit"].item()
    assert table["predicted_limit"].item() == 1


@pytest.mark.parametrize("axis", ["printed_full", "printed_partial"])
def test_the_printed_index_converges_below_half_the_limit(axis: str) -> None:
    """Above it a bounded cycle is left: the clip keeps every iterate within a few times the solution."""
    table = of(axis)
    assert np.all(table["outcome"].values[table["value"].values < 0.5] == "right")
    assert np.all(table["measured"] < 10)


def test_the_step_in_full_contact_leaves_a_bounded_cycle() -> None:
    table = of("step_full")
    above = table["value"].values > 1
    assert np.all(table["measured"].values[above] > 0.1)
    assert np.all(table["measured"].values[above] < 10)
    assert np.all(table["measured"].values[~above] < 1e-12)


def test_single_precision_stops_where_double_goes_on() -> None:
    assert np.all(of("single")["measured"].values > 1e6 * of("double")["measured"].values)
    assert set(of("double")["outcome"].values) == {"right"}
    share = of("double")["measured"].values / of("double")["predicted"].values
    assert np.all((share > 0.1) & (share < 10))


def test_the_figure_s_rows_are_the_points() -> None:
    frame = figure.table(ROOT / "results/extremes/extremes.nc")
    assert len(frame) == stored().sizes["point"]
    np.testing.assert_allclose(10 ** frame["log10_value"], stored()["value"], rtol=1e-12)
    rescued = frame["kind"] == RESCUED
    assert np.all(stored()["tool"].values[rescued] == "right")
    assert np.count_nonzero(rescued) == np.count_nonzero(
        (stored()["outcome"] != "right") & (stored()["tool"] == "right")
    )


def test_every_axis_is_in_one_of_the_two_tables() -> None:
    limited, others = extremes_tables.limits(stored()), extremes_tables.unlimited(stored())
    assert {*limited["axis"], *others["axis"]} == {axis["label"] for axis in AXES.values()}
    assert len(limited) + len(others) == len(AXES)


def test_the_paper_names_every_axis_that_has_settings_of_its_own() -> None:
    paper = marks.without_marks((ROOT / "paper.md").read_text(encoding="utf-8"))
    own = [name for name, axis in AXES.items() if {"h", "H", "accuracy"} & set(axis)]
    assert len(own) == 3
    assert "Three axes have settings of their own." in paper
    for axis in own:
        assert f"For *{AXES[axis]['label']}* " in paper
    assert f"but at least {problem.LEAST:g}, times" in paper


def outcomes() -> dict[str, Any]:
    return numbers.flat(numbers.outcomes(stored()))


def test_what_is_allowed_is_below_the_power_of_ten_that_is_printed() -> None:
    """With a factor 2 to spare, and needed somewhere; a smaller one, by 100, would be too small."""
    error, bound, allowance, u_norm = values("true_error", "guaranteed", "allowance", "u_norm")
    printed = outcomes()["allowed"]
    solved = u_norm > 0
    share = printed / np.max(allowance[solved] / u_norm[solved])
    assert 2 <= share <= 100
    assert np.any(error > bound)
    tried = np.isfinite(error)
    assert np.all(error[tried] <= (bound + printed * u_norm)[tried])


def test_no_bound_that_is_rounding_is_near_its_tolerance() -> None:
    """Else the CPU decides: at 1e-4 outcomes in single precision were those of one kind of CPU."""
    for name in ("single", "double"):
        share = of(name)["guaranteed"].values / of(name)["tolerance"].values
        assert not np.any((share > 1 / 3) & (share < 3))
        assert set(of(name)["outcome"].values[share > 1]) <= {"not converged"}
    assert of("single")["measured_limit"].item() == 1 / 32


def test_axes_without_limits_are_in_a_table_of_their_own() -> None:
    limited, others = (list(f(stored())["axis"]) for f in (extremes_tables.limits, extremes_tables.unlimited))
    for name in AXES:
        label, right = of(name)["label"].item(), set(of(name)["outcome"].values) == {"right"}
        limits = [of(name)[limit].item() for limit in ("predicted_limit", "predicted_tool_limit")]
        assert (label in limited) != (label in others)
        assert (label in others) == (right and bool(np.isnan(limits).all()))
    assert outcomes()["axes.unlimited"] == len(others)


def test_every_point_is_counted_once() -> None:
    found = outcomes()
    kinds = ("right", "by_tool", "not_converged", "refused", "wrong")
    assert sum(found[kind] for kind in kinds) == found["points"] == stored().sizes["point"]


def test_the_condition_numbers_excess() -> None:
    """By hand: 2.05 on `angle`, the largest."""
    assert outcomes()["cond_over_law"] == pytest.approx(2.05, abs=0.005)
    share = (stored()["measured"] / stored()["predicted"]).values
    law = np.isin(stored()["axis_of"].values, numbers.LAWS) & np.isfinite(share)
    assert set(stored()["axis_of"].values[law & (share > 2)]) == {"angle"}
