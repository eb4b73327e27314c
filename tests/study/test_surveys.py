"""The stored surveys of beta: what Lemma 3.1 and simple linear algebra say of every one."""

from functools import cache

import numpy as np
import pytest
import yaml
from conftest import ROOT

from unilateral.study import tables

STUDY = yaml.safe_load((ROOT / "workflow/config/study.yaml").read_text())
SURVEYS = STUDY["surveys"]
FINDS = yaml.safe_load((ROOT / "workflow/config/worst_infsup.yaml").read_text())["finds"]


@cache
def survey(name):
    return tables.load(ROOT / f"results/{name}/infsup.nc")


@pytest.fixture(params=SURVEYS)
def table(request):
    return survey(request.param)


def test_beta_is_known_to_half_a_percent(table):
    lower, upper = table["beta_lower"].values, table["beta_upper"].values
    assert np.all((lower >= 0) & (lower <= upper) & (upper <= 1))
    assert np.all(upper <= 1.005 * lower)


@pytest.mark.parametrize("name", ["betasquare", "betagmsh", "betalshape", "betalshapegmsh"])
def test_beta_is_0_where_the_partition_has_more_cells_than_the_mesh_boundary_nodes(name):
    """Equal cells and edges, so the counts are as the sizes; at H = h they are equal, and even."""
    table = survey(name)
    no_fewer = table["h_over_H"].values >= 1 - 1e-9
    assert no_fewer.any()
    assert np.array_equal(table["beta_upper"].values == 0, no_fewer)


def test_the_worst_multiplier_is_normalised(table):
    worst = table["worst"].values
    known = np.isfinite(worst).any(axis=-1)
    largest = np.nanmax(np.abs(worst[known]), axis=-1)
    np.testing.assert_allclose(largest, 1, rtol=2e-3)  # the first of those within 1e-3 of the largest is 1


def test_at_h_equal_to_H_beta_vanishes_on_an_even_boundary_and_not_on_an_odd_one():
    """The kernel (-1)^e/|e| closes up for an even number of edges only; the multiplier shows it."""
    even, odd = survey("betasquare"), survey("betaodd")
    k = int(np.abs(even["edges_per_cell"].values[:, 0] - 1).argmin())
    assert even["beta_upper"].values[k, 0] == 0
    kernel = even["worst"].values[k, 0]
    kernel = kernel[np.isfinite(kernel)]
    np.testing.assert_allclose(kernel, (-1.0) ** np.arange(len(kernel)), atol=1e-6)
    assert odd["edges_per_cell"].values[0, 0] == pytest.approx(1, abs=1e-9)
    assert 0 < odd["beta_lower"].values[0, 0] < 0.1


@pytest.mark.parametrize("name", [name for name, each in SURVEYS.items() if each["kind"] == "uniform"])
def test_on_uniform_meshes_beta_grows_with_the_edges_per_cell(name):
    """V_h of nested meshes, K = 1, 2, 4: each beta is between bounds."""
    table = survey(name)
    K = table["edges_per_cell"].values[:, 0]
    nested = [int(np.abs(K - k).argmin()) for k in (1, 2, 4)]
    np.testing.assert_allclose(K[nested], (1, 2, 4), rtol=1e-6)
    if SURVEYS[name]["mesh"]["kind"] == "structured":
        assert np.all(table["beta_lower"].values[nested[:-1]] <= table["beta_upper"].values[nested[1:]])
    assert np.all(np.diff(table["beta_upper"].values[nested, 0]) > 0)


def by_edges(name):
    """beta by the number of edges per cell."""
    of = survey(name).isel(partition=0)
    return dict(zip(np.round(of["edges_per_cell"].values, 6), of["beta_lower"].values, strict=True))


def test_at_a_fixed_ratio_beta_is_uniform_in_h():
    """H = 1/16 and 1/32: Lemma 3.1's constant depends on the ratio only; the corners' share is below 5 %."""
    coarse, fine = (by_edges("betasquare"), by_edges("betasquarefine"))
    common = sorted(K for K in coarse.keys() & fine.keys() if coarse[K] > 0)
    assert len(common) >= 6
    np.testing.assert_allclose([fine[K] for K in common], [coarse[K] for K in common], rtol=0.05)
    control = np.array([coarse[K] for K in common])
    assert np.all(control[1:] / control[:-1] > 1.05)


def test_the_finds_are_as_bad_as_their_search_says():
    """Three digits, and a percent for another gmsh."""
    beta = survey("betaworst")["beta_upper"].values[0]
    np.testing.assert_allclose(beta, [find["beta"] for find in FINDS], rtol=0.01)


def test_the_rule_for_beta_is_judged_on_many_pairs():
    """By claim S.local, on more than thirty."""
    rule = STUDY["infsup"]["rule"]
    fine = [
        np.all([table[name].values >= least * (1 - 1e-9) for name, least in rule.items()], axis=0)
        for table in map(survey, SURVEYS)
    ]
    assert sum(map(np.count_nonzero, fine)) > 30


def test_two_edges_in_every_cell_are_not_enough():
    """A finding: with edges of very different lengths beta is below 0.2 at two edges in every cell."""
    table = survey("betaworst")
    two = table["edges_per_cell"].values[0] >= 2 - 1e-6
    assert table["beta_upper"].values[0][two].min() < 0.2
