"""Meshes graded to a vertex, what is measured on them, and the orders formed of it."""

from dataclasses import replace

import numpy as np
import pytest
import sentences
import xarray as xr
from conftest import load
from numpy.testing import assert_allclose

from study.experiments.graded import levels, measure
from study.experiments.graded import numbers as in_documents
from study.experiments.graded.measure import grade_to_vertex, smallest_angle
from unilateral.discrete.condensed import discretise_case
from unilateral.errors import InputError
from unilateral.fem.condense import condense
from unilateral.fem.spaces import mixed_spaces
from unilateral.geometry import mesh as meshes
from unilateral.geometry.polygon import find_polygon, square
from unilateral.geometry.structured import make_structured_mesh
from unilateral.norms.dual import build_dual_norm
from unilateral.norms.exact_errors import project_case
from unilateral.solvers.stop import Stop

LSHAPE = find_polygon("lshape")
HEXAGON = find_polygon("hexagon")
CASE = load("reentrant_full", "lshape")
STOP = Stop(fraction=0.01, algorithm="newton")
COARSE = make_structured_mesh(LSHAPE, 1 / 4)


@pytest.fixture(scope="module")
def spaces():
    """On an L-shape of 65 nodes, graded with kappa = 1/2."""
    mesh = grade_to_vertex(COARSE, 2, 1.0, 0.5)
    return mixed_spaces(condense(mesh), measure.two_edge_cells(mesh))


@pytest.fixture(scope="module")
def graded_tables():
    """Of two levels; the dual norm on the coarser one only."""
    pair = [grade_to_vertex(mesh, 2, 1.0, 0.5) for mesh in (COARSE, meshes.refine_uniformly(COARSE))]
    return measure.measure_levels(pair, CASE, 16, STOP)


@pytest.mark.parametrize("kappa", [0.5, 0.7])
def test_nodes_on_the_sides_lie_at_the_powers_and_those_far_away_stay(kappa):
    """On the side from (0, 0) to (1, 0), at (j/4)^(1/kappa); on the hexagon R = 2/5 moves some nodes only."""
    mesh = grade_to_vertex(COARSE, 2, 1.0, kappa)
    x, y = mesh.points.T
    on_side = np.sort(x[(np.abs(y) < 1e-14) & (x >= 0)])
    assert_allclose(on_side, (np.arange(5) / 4) ** (1 / kappa), rtol=1e-13, atol=1e-15)
    equal = meshes.make_unstructured_mesh(HEXAGON, 1 / 8)
    shifted = grade_to_vertex(equal, 1, 0.4, kappa)
    distance = np.hypot(*(equal.points - HEXAGON.vertices[1]).T)
    way = np.hypot(*(shifted.points - equal.points).T)
    assert_allclose(way[distance >= 0.4], 0, atol=1e-15)
    assert np.all(way[(distance > 0.01) & (distance < 0.39)] > 0.001)
    assert np.all(shifted.areas > 0)
    assert shifted.areas.sum() == pytest.approx(HEXAGON.area, rel=1e-13)


def test_without_grading_the_mesh_is_the_same():
    assert np.array_equal(grade_to_vertex(COARSE, 2, 1.0, 1.0).points, COARSE.points)


def test_sizes_are_like_h_times_the_power_of_the_distance():
    """The quotient of h_T and h r^(1 - kappa) stays within a factor of 5 from level to level.

    Control: without the power it grows.
    """
    kappa = 0.5
    spread = []
    control = []
    for mesh in (COARSE, meshes.refine_uniformly(COARSE, 2), meshes.refine_uniformly(COARSE, 4)):
        graded = grade_to_vertex(mesh, 2, 1.0, kappa)
        r = np.hypot(*graded.points[graded.triangles].mean(axis=1).T)
        share = graded.longest_edges / (mesh.h * r ** (1 - kappa))
        spread.append(share.max() / share.min())
        control.append(np.ptp(np.log(graded.longest_edges)))
    assert max(spread) < 5
    assert np.all(np.diff(control) > 1)


def test_angles_are_bounded_below_from_level_to_level():
    """By hand: 45 degrees in half squares, and the smaller angle of a right triangle with legs 1 and 2."""
    assert smallest_angle(COARSE) == pytest.approx(45, abs=1e-9)
    flat = meshes.from_arrays(find_polygon("square"), [[0, 0], [1, 0], [1, 1], [0, 1], [0.5, 0.25]], FAN)
    assert smallest_angle(flat) == pytest.approx(np.degrees(np.arctan(0.5)), abs=1e-9)
    angles = [
        smallest_angle(grade_to_vertex(meshes.refine_uniformly(COARSE, k), 2, 1.0, 0.5)) for k in range(1, 4)
    ]
    assert_allclose(angles, angles[0], rtol=1e-6)


FAN = [[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]]


def test_what_cannot_be_graded_so_is_refused():
    """Too strong a grading leaves no area; three edges on each side leave no cells of two."""
    with sentences.raises(InputError):
        grade_to_vertex(COARSE, 2, 1.0, 0.01)
    with sentences.raises(InputError):
        measure.two_edge_cells(make_structured_mesh(square(), 1 / 3))


def test_cells_have_two_edges_and_a_node_well_inside(spaces):
    """The nearest ones to the vertex by hand: the node is at a quarter of the cell, as (1/2)^2."""
    mesh_resolution = measure.mesh_resolution(spaces)
    assert np.array_equal(spaces.partition.points, spaces.mesh.s[::2])
    assert mesh_resolution["delta"] == pytest.approx(1 / 4, rel=1e-12)
    assert mesh_resolution["alpha_1"] == pytest.approx(3, rel=1e-12)
    assert mesh_resolution["unknowns"] == 65


def test_in_full_contact_the_problem_is_linear(spaces):
    """The multiplier is the sum of those of both parts of u, which a solve with both signs gives.

    Control: the singular part's has both signs, and so is no solution of a contact problem.
    """
    singular_atom, smooth_atom = CASE.atoms
    singular = replace(CASE, atoms=(singular_atom,))
    smooth = replace(CASE, atoms=(smooth_atom,))
    equality_multipliers = [
        measure.equality_multiplier(discretise_case(spaces, project_case(component, spaces)))
        for component in (singular, smooth)
    ]
    case = project_case(CASE, spaces)
    solution = discretise_case(spaces, case).solve(Stop(tolerance=1e-10, algorithm="active_set"))
    assert solution.lambda_H.min() > 0
    assert_allclose(sum(equality_multipliers), solution.lambda_H, rtol=1e-9, atol=1e-9)
    assert equality_multipliers[0].min() < 0 < equality_multipliers[0].max()


def test_the_error_of_the_singular_part_follows_from_the_split(spaces):
    """D by the square of ||u - u_h||_1 less that of ||u - z_h||_1, for the function alone."""
    case = replace(CASE, atoms=(measure.singular_atom(CASE),))
    known_case = project_case(case, spaces)
    mu = measure.equality_multiplier(discretise_case(spaces, known_case))
    h1 = known_case.errors(spaces, mu).h1
    expected = np.sqrt(h1**2 - known_case.ritz.ritz_error**2)
    assert measure.singular_part_error(case, spaces) == pytest.approx(expected, rel=1e-6)


def test_weighted_ritz_means_are_those_of_lemma_1_on_equal_cells():
    """On equal cells H^{-1/2} ||Pi_H(u - z_h)||_0."""
    on_equal = mixed_spaces(condense(COARSE), measure.two_edge_cells(COARSE))
    case = project_case(CASE, on_equal)
    expected = case.ritz_means_norm(on_equal) * 0.5**-0.5
    assert measure.weighted_ritz_means(case, on_equal) == pytest.approx(expected, rel=1e-12)


def test_one_reference_mesh_serves_all_levels_with_few_cells(graded_tables):
    """Beyond that the dual norm is not known. Control: the forms of the level's own reference mesh."""
    assert graded_tables["hm12_error_lower"].isnull().values.tolist() == [False, True]
    finer = [grade_to_vertex(meshes.refine_uniformly(COARSE, k), 2, 1.0, 0.5) for k in range(2)]
    levels = measure.measure_levels(finer, CASE, 32, STOP)
    partition = measure.two_edge_cells(finer[0])
    form = build_dual_norm(partition, [CASE]).gram([CASE])
    assert len(partition.lengths) == 16
    for name in ("hm12_error_lower", "hm12_error_upper", "beta_lower"):
        assert float(levels[name][0]) == pytest.approx(float(graded_tables[name][0]), rel=0.01)
    assert form.n_cells == 16
    assert float(levels["hm12_error_lower"][0]) <= float(graded_tables["hm12_error_upper"][0])


def test_labels_say_which_case_and_singularity(graded_tables):
    assert graded_tables["case"].item() == "reentrant_full"
    assert float(graded_tables["exponent"]) == pytest.approx(2 / 3)
    assert graded_tables["unknowns"].values.tolist() == [65, 225]


def test_adapted_meshes_keep_the_limit_and_grade_to_the_vertex():
    """The shortest edge is halved with nearly every step. D by the split of ||u - u_h||_1."""
    scene = {"polygon": "lshape", "mesh": {"kind": "structured", "h": "1/4"}}
    rows = list(measure.measure_refined_levels(scene, CASE, 400, Stop(fraction=1e-4)))
    assert rows[0]["unknowns"] == 65
    assert rows[-1]["unknowns"] <= 400
    assert [row["shortest_edge"] for row in rows] == [1 / 4, 1 / 8, 1 / 16]
    on_first = mixed_spaces(condense(COARSE), measure.two_edge_cells(COARSE))
    ritz = project_case(CASE, on_first).ritz.ritz_error
    expected = np.sqrt(rows[0]["h1_error"] ** 2 - ritz**2)
    assert rows[0]["discrete_error"] == pytest.approx(expected, rel=1e-4)


def test_orders_are_those_of_made_up_powers():
    """Errors like 4^-level have the order 2; unknowns 1, 2, 4, .. and errors 1/N the order 2 in N^-1/2."""
    error = xr.DataArray([[1, 1 / 4, 1 / 16], [1, 1, np.nan]], dims=("run", "level"))
    assert_allclose(levels.rates_by_halving(error), [[2, 2], [0, np.nan]])
    N = np.array([1, 2, 4, 8, 16, np.nan])
    assert_allclose(levels.orders_between_levels(N, 1 / N, 4), [2, 2, 2])
    assert_allclose(levels.orders_between_levels(N, N**-0.25, 16), [0.5])
    assert not len(levels.orders_between_levels(N, 1 / N, 17))


def test_documents_show_the_orders_on_the_finest_known_pair():
    """Of two runs with errors like 2^(-p level); on the finest pair that is known."""
    fall = 2.0 ** -np.outer([1, 2], np.arange(3))
    names = ("h1_error", "discrete_error", "singular_error", "hm12_error_lower", "hm12_error_upper")
    table = xr.Dataset({name: (("run", "level"), fall.copy()) for name in names})
    table["hm12_error_upper"][0, 2] = np.nan
    table = table.assign_coords(
        case=("run", ["a", "b"]), kappa=("run", [1.0, 0.5]), exponent=("run", [2 / 3] * 2)
    )
    rows = in_documents.tabulate_graded_orders(table)
    assert rows.iloc[0].tolist() == ["`a`", "1.5π", "1", "0.67", "0.67", *["1.00"] * 4]
    assert rows.iloc[1].tolist() == ["`b`", "1.5π", "0.5", "1.33", "1.33", *["2.00"] * 4]
    N = np.array([[10.0, 40, 160, 640]])
    order = ("case", "level")
    fields = {"unknowns": (order, N), "h1_error": (order, N**-0.5)}
    fields |= {"discrete_error": (order, np.array([[1, 1, 1 / 16, 1 / 64]])), "shortest_edge": (order, 1 / N)}
    (row,) = in_documents.tabulate_adapted_orders(xr.Dataset(fields, coords={"case": ["a"]})).values.tolist()
    assert row == ["`a`", "640", "1.00 to 1.00", "2.00 to 3.00", "2.00 to 2.00"]
