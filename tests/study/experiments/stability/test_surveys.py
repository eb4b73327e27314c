"""The stored surveys of beta: what Lemma 3.1 and simple linear algebra say of every one."""

import numpy as np
import pytest
from conftest import config, read_stored_table

from unilateral.norms.resolution import RULE

STUDY = config("study")
FINDS = config("worst_infsup")["finds"]
SURVEYS = STUDY["surveys"]


def survey(name):
    return read_stored_table(f"{name}/infsup")


def surveys():
    return [(name, survey(name)) for name in SURVEYS]


def keeps_rule(table):
    """Which pairs keep the library's rule, up to rounding."""
    retained = [table[name].values >= minimum * (1 - 1e-9) for name, minimum in RULE._asdict().items()]
    return np.all(retained, axis=0)


@pytest.mark.parametrize("name", SURVEYS)
def test_beta_is_known_to_half_a_percent_and_the_worst_multiplier_normalised(name):
    """The first of its values within 1e-3 of the largest is 1."""
    lower = survey(name)["beta_lower"].values
    upper = survey(name)["beta_upper"].values
    worst = survey(name)["worst"].values
    assert np.all((lower >= 0) & (lower <= upper) & (upper <= 1))
    assert np.all(upper <= 1.005 * lower)
    expected = np.isfinite(worst).any(axis=-1)
    np.testing.assert_allclose(np.nanmax(np.abs(worst[expected]), axis=-1), 1, rtol=2e-3)


@pytest.mark.parametrize("name", ["betasquare", "betagmsh", "betalshape", "betalshapegmsh"])
def test_beta_is_0_where_the_partition_has_more_cells_than_the_mesh_boundary_nodes(name):
    """Equal cells and edges, so the counts are as the sizes; at H = h they are equal, and even."""
    table = survey(name)
    no_fewer = table["h_over_H"].values >= 1 - 1e-9
    assert no_fewer.any()
    assert np.array_equal(table["beta_upper"].values == 0, no_fewer)


def test_at_h_equal_to_H_beta_vanishes_on_an_even_boundary_and_not_on_an_odd_one():
    """The kernel (-1)^e/|e| closes up for an even number of edges only; the multiplier shows it."""
    even = survey("betasquare")
    odd = survey("betaodd")
    k = int(np.abs(even["edges_per_cell"].values[:, 0] - 1).argmin())
    assert even["beta_upper"].values[k, 0] == 0
    kernel = even["worst"].values[k, 0]
    kernel = kernel[np.isfinite(kernel)]
    np.testing.assert_allclose(kernel, (-1.0) ** np.arange(len(kernel)), rtol=0, atol=1e-6)
    assert odd["edges_per_cell"].values[0, 0] == pytest.approx(1, abs=1e-9)
    assert 0 < odd["beta_lower"].values[0, 0] < 0.1


@pytest.mark.parametrize("name", [name for name, survey in SURVEYS.items() if survey["kind"] == "uniform"])
def test_on_uniform_meshes_beta_grows_with_the_edges_per_cell(name):
    """V_h of nested meshes, K = 1, 2, 4: each beta is between bounds."""
    table = survey(name)
    K = table["edges_per_cell"].values[:, 0]
    nested = [int(np.abs(K - k).argmin()) for k in (1, 2, 4)]
    np.testing.assert_allclose(K[nested], (1, 2, 4), rtol=1e-6)
    if SURVEYS[name]["mesh"]["kind"] == "structured":
        assert np.all(table["beta_lower"].values[nested[:-1]] <= table["beta_upper"].values[nested[1:]])
    assert np.all(np.diff(table["beta_upper"].values[nested, 0]) > 0)


def test_at_a_fixed_ratio_beta_is_uniform_in_h():
    """H = 1/16 and 1/32: Lemma 3.1's constant depends on the ratio only; the corners' share is below 5 %."""

    def beta_by_ratio(name):
        row = survey(name).isel(partition=0)
        return dict(zip(np.round(row["edges_per_cell"].values, 6), row["beta_lower"].values, strict=True))

    coarse = beta_by_ratio("betasquare")
    fine = beta_by_ratio("betasquarefine")
    common = sorted(K for K in coarse.keys() & fine.keys() if coarse[K] > 0)
    assert len(common) >= 6
    computed = np.array([fine[K] for K in common])
    expected = np.array([coarse[K] for K in common])
    np.testing.assert_allclose(computed, expected, rtol=0.05)
    assert np.all(expected[1:] / expected[:-1] > 1.05)  # control


@pytest.mark.parametrize("name", FINDS)
def test_the_finds_are_as_bad_as_their_search_says(name):
    """Three digits, and a percent for another gmsh."""
    beta = survey(name)["beta_upper"].values[0]
    np.testing.assert_allclose(beta, [find["beta"] for find in FINDS[name]], rtol=0.01)


def test_the_finds_of_the_search_with_the_rule_keep_it():
    """And the worst of all pairs that keep it is one of them, so the search was of use."""
    worst = {name: table["beta_upper"].values[keeps_rule(table)] for name, table in surveys()}
    assert len(worst["betarule"]) == len(FINDS["betarule"])
    min_betas = {name: beta.min() for name, beta in worst.items() if len(beta)}
    assert min(min_betas, key=min_betas.get) == "betarule"


def test_the_rule_for_beta_is_judged_on_many_pairs():
    """By claim S.local, on more than thirty."""
    assert sum(np.count_nonzero(keeps_rule(table)) for _, table in surveys()) > 30
