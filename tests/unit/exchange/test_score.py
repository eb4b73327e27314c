"""Solutions of other solvers: right ones score their errors, and each spoilt one is named for what it is."""

import json
import re
import shutil
from contextlib import nullcontext
from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import author
import numpy as np
import pandas as pd
import pytest
import sentences
import xarray as xr
from conftest import ROOT, couple_structured_mesh, discrete, load

from unilateral.cli import exchange, main
from unilateral.discrete.condensed import solve_condensed_problem
from unilateral.errors import InputError
from unilateral.exchange.boundary_function import piecewise_constant, piecewise_linear, represent_reactions
from unilateral.exchange.diagnosis import Diagnosis
from unilateral.exchange.exported_folder import (
    ForeignSolution,
    last_digit_unit,
    read_exported_folder,
    read_foreign_solution,
)
from unilateral.exchange.fault import Fault
from unilateral.exchange.score import (
    Extreme,
    Extremes,
    Rate,
    ScoredSolution,
    compute_rates,
    passes_judgement,
    score_solution,
    select_error,
    state_verdict,
)
from unilateral.fem.p1 import boundary_mass
from unilateral.fem.spaces import mixed_spaces
from unilateral.geometry import partition as partitions
from unilateral.geometry.polygon import square
from unilateral.norms.dual import Errors
from unilateral.solution.solution import Solution

pytestmark = pytest.mark.usefixtures("levels_solved_once")
LEVELS = {"level_0": (4, 2), "level_1": (8, 4), "level_2": (16, 8)}
FINEST = (16, 8)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    exported = tmp_path_factory.mktemp("score") / "natural"
    options = ["--h", "1/16", "--H", "1/8", "--levels", "3", "--out", str(exported)]
    assert main(["export", "natural", *options]) == 0
    return exported


def keep_solution(level):
    """The solution of a case's discrete problem."""
    return Solution(level.exact.ritz.case.problem, solve_condensed_problem(level))


@cache
def solve_own(n, m):
    return keep_solution(discrete("natural", n, m))


@pytest.fixture
def score_permuted_solution(folder, tmp_path):
    """The score of u and columns beside it, its nodes permuted; cells are (points, values)."""
    case, levels = read_exported_folder(folder)

    def scoring(u, cells=None, **nodal):
        points = levels[-1].mesh.points
        table = pd.DataFrame({"x": points[:, 0], "y": points[:, 1], "u": u, **nodal})
        table.sample(frac=1, random_state=1).to_csv(tmp_path / "u.csv", index=False)
        if cells is None:
            return score_solution(case, read_foreign_solution(levels, str(tmp_path / "u.csv")))
        s, values = cells
        columns = {"start": s[:-1], "end": s[1:], "multiplier": values}
        pd.DataFrame(columns).to_csv(tmp_path / "cells.csv", index=False)
        return score_solution(
            case, read_foreign_solution(levels, str(tmp_path / "u.csv"), str(tmp_path / "cells.csv"))
        )

    return scoring


@pytest.mark.parametrize("ending", [".nc", ".vtu"])
def test_this_projects_own_solution_scores_its_own_errors(folder, tmp_path, ending):
    """By `Solution.errors`, which never saw a file. A wrong node, cell or edge would change all three."""
    case, levels = read_exported_folder(folder)
    scores = []
    for level, sizes in zip(levels, LEVELS.values(), strict=True):
        solution = solve_own(*sizes)
        solution.save(tmp_path / f"{level.name}{ending}")
        scored_solution = score_solution(
            case, read_foreign_solution(levels, str(tmp_path / f"{level.name}{ending}"))
        )
        assert (scored_solution.solution.level.name, scored_solution.faults) == (level.name, [])
        # On edges the same function takes other quadrature points; `dual` rounds 1e-9 of the norm of lambda.
        np.testing.assert_allclose(
            scored_solution.errors, solution.errors, rtol=1e-12 if ending == ".nc" else 1e-6
        )
        np.testing.assert_allclose(scored_solution.reference_errors, solution.errors, rtol=1e-12)
        scores.append(scored_solution)
    ladder = compute_rates(case, scores)
    assert {norm: rate.pairs for norm, rate in ladder.items()} == {"h1": 1, "hm12": 1, "l2": 1}
    last = solve_own(*LEVELS["level_1"]).errors
    finest = solve_own(*LEVELS["level_2"]).errors
    assert ladder["h1"].observed == pytest.approx(np.log2(last.h1 / finest.h1), rel=1e-9)
    assert state_verdict(scores, ladder) == "reaches the proved rates"


@pytest.mark.parametrize("proved", [1.0, 0.5])
def test_a_rate_may_fall_short_by_what_is_documented(proved):
    """By 0.1, on either side of it."""
    assert "A rate may fall short by 0.1." in (ROOT / "docs/own-solver.md").read_text()
    just = Rate(proved - 0.09, 1, proved, proved).verdict
    short = Rate(proved - 0.11, 1, proved, proved).verdict
    assert (just, short) == ("reaches the proved rate", "falls short")


def test_rates_are_over_levels_with_h_and_H_small_enough():
    """`natural` counts from h = 1/8 and H = 1/4 on: not h = 1/8 with H = 1/2, nor levels 2.05 apart."""
    sizes = ((1 / 8, 1 / 2), (1 / 16, 1 / 4), (1 / 32, 1 / 8))
    levels = [SimpleNamespace(mesh=SimpleNamespace(h=h), partition=SimpleNamespace(H=H)) for h, H in sizes]
    errors = [Errors(e, e, e, e) for e in (1.0, 0.5, 0.25)]
    ladder = [
        ScoredSolution(
            ForeignSolution("", level, np.zeros(0), None, ""), error, error, Diagnosis([], []), None
        )
        for level, error in zip(levels, errors, strict=True)
    ]
    for rate in compute_rates(load("natural").problem, ladder).values():
        assert (rate.pairs, rate.observed) == (1, 1)
    levels[2].mesh.h = 1 / 32.8
    assert [rate.pairs for rate in compute_rates(load("natural").problem, ladder).values()] == [0, 0, 0]


def ladder(*errors, sizes=(1 / 8, 1 / 16, 1 / 32, 1 / 64)):
    """Solutions on levels with such errors, the own ones all 1; H = 2h."""
    levels = [SimpleNamespace(mesh=SimpleNamespace(h=h), partition=SimpleNamespace(H=2 * h)) for h in sizes]
    foreign_solutions = [ForeignSolution("", level, np.zeros(0), None, "") for level in levels]
    original = Errors(1.0, 1.0, 1.0, 1.0)
    pairs = zip(foreign_solutions, errors, strict=False)
    return [
        ScoredSolution(first, Errors(*4 * [item]), original, Diagnosis([], []), None) for first, item in pairs
    ]


@pytest.mark.parametrize(("name", "polygon"), [("violates_j", "lshape"), ("violates_jj", "square")])
def test_no_rate_is_proved_where_a_hypothesis_fails(name, polygon):
    """Neither rate is short then, however slow; control: `natural`, for which all hypotheses hold."""
    case = load(name, polygon).problem
    assert not all(case.exact.declaration["hypotheses"].values())
    slow = ladder(*[1.0] * 8, sizes=0.5 ** np.arange(3, 11))
    rates = compute_rates(case, slow)
    assert np.isnan([rate.proved for rate in rates.values()]).all()
    assert {rate.verdict for rate in rates.values()} <= {"no rate is proved", "not judged"}
    assert {rate.verdict for rate in compute_rates(load("natural").problem, slow).values()} == {"falls short"}


@pytest.mark.parametrize("fine", [0.0, 1e-13])
def test_an_error_of_0_up_to_rounding_has_no_rate(fine):
    """Neither as the finer of a pair nor as the coarser; the pair before it counts."""
    rate = compute_rates(load("natural").problem, ladder(1.0, 0.25, fine, fine))["h1"]
    assert (rate.pairs, rate.observed) == (1, 2.0)


def test_the_slowest_pair_counts_and_own_rates_are_apart():
    """By hand: errors halve, quarter and halve, so the rates of pairs are 1, 2 and 1."""
    rate = compute_rates(load("natural").problem, ladder(1.0, 0.5, 0.125, 0.0625))["h1"]
    assert (rate.pairs, rate.observed, rate.own, rate.proved) == (3, 1.0, 0.0, 1.0)


def test_rates_are_by_the_factor_that_the_case_names():
    """4 for lambda of `thirds`, whose transitions lie at thirds: log 16 / log 4 between levels 4 apart."""
    case = load("thirds").problem
    assert float(case.exact.declaration["asymptotic"]["l2"]["factor"]) == 4
    sizes = 0.5 ** np.arange(6, 11)
    rate = compute_rates(case, ladder(1.0, 0.9, 1 / 16, 0.05, 1 / 256, sizes=sizes))["l2"]
    assert (rate.pairs, rate.proved) == (3, 0.5)
    assert rate.observed == pytest.approx(2.0)


def test_of_two_bounds_the_root_mean_square_is_the_error():
    """Of 3 and 4 it is the root of 12.5; other norms have one number."""
    errors = Errors(1.0, 3.0, 4.0, 2.0)
    selected_errors = [select_error(errors, norm) for norm in ("h1", "hm12", "l2")]
    assert selected_errors == pytest.approx([1.0, np.sqrt(12.5), 2.0])


@pytest.mark.parametrize(("displaced", "refused"), [(1e-8, False), (1e-4, True)])
def test_places_that_are_off_by_more_than_rounding_are_another_mesh(folder, tmp_path, displaced, refused):
    """Of h: seven digits are enough in a file, but a node elsewhere is another node."""
    _, levels = read_exported_folder(folder)
    mesh = levels[-1].mesh
    x, y = mesh.points.T + displaced * mesh.h / np.sqrt(2)
    pd.DataFrame({"x": x, "y": y, "u": 0 * x}).to_csv(tmp_path / "u.csv", index=False)
    with sentences.raises(InputError) if refused else nullcontext():
        assert read_foreign_solution(levels, str(tmp_path / "u.csv")).level is levels[-1]


@pytest.fixture(scope="module")
def twelfths(tmp_path_factory):
    """`natural` with h = 1/12, whose nodes are no decimal numbers, and a solution by another author."""
    exported = tmp_path_factory.mktemp("twelfths") / "natural"
    assert main(["export", "natural", "--h", "1/12", "--H", "1/6", "--out", str(exported)]) == 0
    return exported, *author.solve_level(author.read(exported, "level_0"), "")


WRITTEN = {"6 digits": "%.6g", "8 digits": "%.8g", "6 decimals": "%.6f", "all": None, "float32": "float32"}


@pytest.mark.parametrize("digits", WRITTEN)
def test_places_are_known_to_the_digits_that_are_written(twelfths, tmp_path, digits):
    """The errors are those of the numbers in full, up to the rounding of the values.

    That is 5e-7 of u, whose gradient is at most some 3 times that over h = 1/12, and 5e-6 of lambda, times
    at most ||1||_{-1/2} = 4.1.
    """
    exported, u, cells = twelfths
    case, levels = read_exported_folder(exported)

    def scored_as(form):
        single = form == "float32"
        for table, name in ((u, "u.csv"), (cells, "cells.csv")):
            rounded = table.astype(np.float32).astype(float) if single else table
            rounded.to_csv(tmp_path / name, index=False, float_format=None if single else form)
        return score_solution(
            case, read_foreign_solution(levels, str(tmp_path / "u.csv"), str(tmp_path / "cells.csv"))
        )

    score = scored_as(WRITTEN[digits])
    full = scored_as(None)
    assert (score.faults, full.faults) == ([], [])
    np.testing.assert_allclose(score.errors, full.errors, rtol=0, atol=2e-5)


@pytest.mark.parametrize("digits", [1, 2])
def test_places_with_too_few_digits_are_another_mesh(twelfths, tmp_path, digits):
    """Control: 1/12 is written as 0.1 or 0.08, a fifth or a twenty-fifth of an edge off."""
    exported, u, _ = twelfths
    u.to_csv(tmp_path / "u.csv", index=False, float_format=f"%.{digits}f")
    with sentences.raises(InputError):
        read_foreign_solution(read_exported_folder(exported)[1], str(tmp_path / "u.csv"))
    u.assign(x=u.x**1.1).to_csv(tmp_path / "u.csv", index=False)
    with sentences.raises(InputError):
        read_foreign_solution(read_exported_folder(exported)[1], str(tmp_path / "u.csv"))


@pytest.mark.parametrize("form", ["%.{}g", "%.{}f"])
def test_the_unit_of_the_last_digit_bounds_what_rounding_leaves(form):
    """Rounding to nearest leaves half of it at most; the format's is no more than ten times smaller.

    It is smaller where all numbers happen to have fewer digits, as 0.010 and 0.009.
    """
    rng = np.random.default_rng(2)
    for digits in range(3, 12):
        for _ in range(20):
            exact = rng.uniform(-1, 1, 40) * 10.0 ** rng.integers(-2, 3)
            text = [form.format(digits) % number for number in exact]
            unit = last_digit_unit(np.array(text, dtype=float))
            assert np.abs(np.array(text, dtype=float) - exact).max() <= 0.51 * unit
            largest = np.floor(np.log10(np.abs(exact).max() * 1.01)) + 1
            assert unit <= 10.1 * (10.0**-digits if "f" in form else 10.0 ** (largest - digits))


def test_numbers_in_full_have_no_last_digit():
    """Control: of 40 random ones none of 15 digits or fewer, nor of single precision."""
    exact = np.random.default_rng(3).uniform(-1, 1, 40)
    assert last_digit_unit(exact) == 0
    assert last_digit_unit(exact.astype(np.float32).astype(float)) == pytest.approx(2**-24, rel=0.01)
    assert last_digit_unit(np.zeros(3)) == 0


@pytest.mark.parametrize(("digits", "expected"), [(6, True), (2, False)])
def test_ends_of_cells_are_vertices_to_the_digits_that_are_written(tmp_path, digits, expected):
    """On a triangle with sides sqrt(1.3) and sqrt(0.9); control: two digits are too few."""
    (tmp_path / "own.yaml").write_text("polygon: [[0, 0], [1, 0], [0.3, 0.9]]\n")
    exported = tmp_path / "made"
    position = ["--polygon", str(tmp_path / "own.yaml"), "--h", "1/8", "--H", "1/4", "--out", str(exported)]
    assert main(["export", "thirds", *position]) == 0
    _, levels = read_exported_folder(exported)
    table = pd.read_csv(exported / "level_0/nodes.csv")[["x", "y"]].assign(u=0.0)
    table.to_csv(tmp_path / "u.csv", index=False)
    cells = pd.read_csv(exported / "level_0/partition.csv")[["start", "end"]].assign(multiplier=0.0)
    cells.to_csv(tmp_path / "cells.csv", index=False, float_format=f"%.{digits}g")
    with nullcontext() if expected else sentences.raises(InputError):
        foreign_solution = read_foreign_solution(levels, str(tmp_path / "u.csv"), str(tmp_path / "cells.csv"))
        np.testing.assert_array_equal(
            foreign_solution.multiplier.partition.points, levels[0].partition.points
        )


@pytest.mark.parametrize(("displaced", "refused"), [(1e-8, False), (1e-4, True)])
def test_cells_that_do_not_meet_are_named(folder, tmp_path, displaced, refused):
    """A cell that begins later than the one before ends, by more than rounding, in h."""
    _, levels = read_exported_folder(folder)
    solve_own(*FINEST).save(tmp_path / "u.nc")
    with xr.open_dataset(tmp_path / "u.nc") as dataset:
        start = dataset.start.to_numpy() + np.where(
            np.arange(len(dataset.start)) == 3, displaced * levels[-1].mesh.h, 0
        )
        dataset.load().assign(start=(dataset.start.dims, start)).to_netcdf(tmp_path / "off.nc")
    with sentences.raises(InputError) if refused else nullcontext():
        read_foreign_solution(levels, str(tmp_path / "off.nc"))


@pytest.mark.parametrize(
    "rows",
    [
        slice(1, None),
        slice(-1),
        [0, 2],
        [],
    ],
)
def test_missing_cells_are_named_with_their_file(folder, tmp_path, rows):
    """Not with the file of u, which is right."""
    _, levels = read_exported_folder(folder)
    cells = pd.read_csv(folder / "level_2/partition.csv").assign(multiplier=0.0)
    cells.iloc[rows].to_csv(tmp_path / "cells.csv", index=False)
    u = pd.DataFrame(levels[-1].mesh.points, columns=["x", "y"]).assign(u=0.0)
    u.to_csv(tmp_path / "u.csv", index=False)
    with sentences.raises(InputError) as error:
        read_foreign_solution(levels, str(tmp_path / "u.csv"), str(tmp_path / "cells.csv"))
    assert str(error.value).startswith(f"{tmp_path / 'cells.csv'}: ")


def test_permuted_nodes_and_cells_of_another_partition_are_no_fault(score_permuted_solution):
    """Each cell in two, with the same value, is the same function."""
    solution = solve_own(*FINEST)
    finer = partitions.divide_cells(solution.partition)
    for cells in (
        (solution.partition.points, solution.multiplier),
        (finer.points, np.repeat(solution.multiplier, 2)),
    ):
        scores = score_permuted_solution(solution.u, cells)
        assert scores.errors.h1 == pytest.approx(solution.errors.h1, rel=1e-12)
        assert scores.errors.l2 == pytest.approx(solution.errors.l2, rel=1e-12)
        assert scores.faults == []


@pytest.mark.parametrize("bug", ["", "g negative", "conditions turned around", "Dirichlet everywhere"])
def test_u_alone_is_not_said_to_meet_the_conditions(folder, tmp_path, run, bug):
    """Its equation holds inside, whatever its conditions are. With its multiplier each bug is a fault."""
    u, cells = author.solve_level(author.read(folder, "level_2"), bug)
    files = [str(tmp_path / name) for name in ("u.csv", "cells.csv")]
    u.to_csv(files[0], index=False)
    cells.to_csv(files[1], index=False)
    unseen = "no fault was found inside; without a multiplier the conditions were not looked at"
    code, out, _ = run("score", folder, files[0])
    assert (code, out.endswith(f"natural: {unseen}\n")) == (0, True)
    document = json.loads(run("score", folder, files[0], "--json")[1])
    conditions = document["solutions"][0]["conditions"]
    assert (document["verdict"], conditions["of"]) == (unseen, "values at the nodes")
    assert (conditions["lambda_least"], conditions["product_largest"]) == (None, None)
    code, out, _ = run("score", folder, files[0], "--multiplier", files[1])
    assert (code, "not looked at" in out) == (bool(bug), False)


def test_one_solution_without_a_multiplier_is_enough_to_be_told():
    """Beside rates that are reached, too; a fault that was found is told alone."""
    scored_solution = ScoredSolution(
        ForeignSolution("", None, np.zeros(0), None, ""), None, None, Diagnosis([], []), None
    )
    two = ScoredSolution(
        ForeignSolution("", None, np.zeros(0), object(), ""), None, None, Diagnosis([], []), None
    )
    reached = {"h1": Rate(1.0, 1, 1.0, 1.0)}
    unseen = "; without a multiplier the conditions were not looked at"
    assert state_verdict([two], reached) == "reaches the proved rates"
    assert state_verdict([scored_solution, two], reached) == "reaches the proved rates" + unseen
    assert state_verdict([scored_solution, two], {}) == "no fault was found inside" + unseen
    wrong = replace(scored_solution, diagnosis=Diagnosis([Fault("wrong", "")], []))
    assert state_verdict([wrong, two], reached) == "faults were found"


def test_what_falls_short_or_is_wrong_does_not_hold():
    """The exit code is made of that; what is not judged, or not looked at, is no fault."""
    right = ScoredSolution(
        ForeignSolution("", None, np.zeros(0), object(), ""), None, None, Diagnosis([], []), None
    )
    wrong = replace(right, diagnosis=Diagnosis([Fault("wrong", "")], []))
    reached = {"h1": Rate(1.0, 1, 1.0, 1.0)}
    short = {"h1": Rate(0.5, 1, 1.0, 1.0)}
    assert passes_judgement([right], reached)
    assert passes_judgement([right], {})
    assert passes_judgement([replace(right, solution=replace(right.solution, multiplier=None))], {})
    assert state_verdict([right], reached | {"l2": Rate(0.1, 1, 0.5, 0.5)}) == "falls short of a proved rate"
    assert not passes_judgement([right], short)
    assert not passes_judgement([wrong], reached)


def test_a_multiplier_may_be_missing_or_reactions(score_permuted_solution):
    """These are the function with such loads; inside, where none are needed, they are NaN."""
    solution = solve_own(*FINEST)
    scores = score_permuted_solution(solution.u)
    assert (scores.solution.multiplier_kind, scores.faults) == ("none", [])
    assert np.isnan(scores.errors[1:]).all()
    mesh = solution.mesh
    reactions = np.full(solution.mesh.n_nodes, np.nan)
    reactions[mesh.boundary] = piecewise_constant(solution.partition, solution.multiplier).load(mesh)
    solution_score = score_permuted_solution(solution.u, reaction=reactions).solution
    assert solution_score.multiplier_kind == "reactions, made a function by the mass matrix"
    np.testing.assert_allclose(
        solution_score.multiplier.load(mesh), reactions[mesh.boundary], rtol=0, atol=1e-12
    )


def test_traces_have_their_loads_and_norms():
    """<1, phi_j> is the mass matrix's row sum; reactions give their function back."""
    mesh = couple_structured_mesh("square", 8, 4).mesh
    multiplier = piecewise_constant(partitions.make_uniform_partition(square(), 1 / 3), np.ones(12))
    masses = boundary_mass(mesh).sum(axis=1)
    np.testing.assert_allclose(multiplier.load(mesh), masses, rtol=1e-13)
    values = np.cos(mesh.s[:-1])
    np.testing.assert_allclose(
        piecewise_linear(mesh, values).load(mesh), boundary_mass(mesh) @ values, rtol=1e-12
    )
    np.testing.assert_allclose(
        represent_reactions(mesh, boundary_mass(mesh) @ values).nodal_values, values, rtol=1e-12
    )
    assert mixed_spaces(couple_structured_mesh("square", 8, 4).condensed, multiplier.partition).B.shape == (
        12,
        32,
    )


def spoilt(spoilt_part, points):
    """A table of u = x at the nodes, spoilt."""
    table = pd.DataFrame({"x": points[:, 0], "y": points[:, 1], "u": points[:, 0]})
    if spoilt_part == "missing":
        return table.drop(index=7)
    if spoilt_part == "mesh":
        return table.assign(x=table.x**1.1)
    if spoilt_part == "twice":
        return pd.concat([table, table.tail(1).assign(u=9.0)])
    if spoilt_part == "name":
        return table.rename(columns={"u": "v"})
    if spoilt_part == "huge":
        table.loc[7, "u"] = 1e200
        return table
    table.loc[7, "u" if spoilt_part == "NaN" else "x"] = np.nan
    return table


@pytest.mark.parametrize(
    ("spoilt_part", "message"),
    [
        ("missing", "1 of the 289 nodes of level_2 are missing"),
        ("mesh", "another mesh"),
        ("NaN", "u is nan at point 7"),
        ("huge", "u is 1e+200 at point 7"),
        ("place", "point 7 has the place (nan"),
        ("twice", "u has two values at"),
        ("name", "x, y and u are needed"),
    ],
)
def test_what_cannot_be_scored_is_one_error(folder, tmp_path, refusal, spoilt_part, message):
    spoilt(spoilt_part, solve_own(*FINEST).mesh.points).to_csv(tmp_path / "u.csv", index=False)
    assert f"{tmp_path / 'u.csv'}: {message}" in refusal("score", folder, tmp_path / "u.csv")


@pytest.mark.parametrize("spoil", [lambda text: "[" * 10**5, lambda text: text | {"levels": []}])
def test_a_damaged_description_of_a_folder_is_one_error(folder, tmp_path, refusal, spoil):
    """Nested too deeply for a parser; without a level."""
    exported = tmp_path / "made"
    shutil.copytree(folder, exported)
    spoilt_text = spoil(json.loads((exported / "problem.json").read_text()))
    text = spoilt_text if isinstance(spoilt_text, str) else json.dumps(spoilt_text)
    (exported / "problem.json").write_text(text)
    assert "not a folder that 'unilateral export' wrote" in refusal("score", exported, "u.csv")


def test_files_that_do_not_fit_together_are_one_error(folder, tmp_path, refusal):
    """A file without multipliers; one for two solutions, which could be meant for either; another folder."""
    solve_own(*FINEST).save(tmp_path / "u.vtu")
    message = refusal("score", folder, tmp_path / "u.vtu", "--multiplier", folder / "level_2/partition.csv")
    assert "the columns start, end and multiplier are needed" in message
    message = refusal("score", folder, "a.vtu", "b.vtu", "--multiplier", "cells.csv")
    assert "--multiplier is given 1 time for 2 solutions; repeat it" in message
    assert "not a folder that 'unilateral export' wrote" in refusal("score", tmp_path, "u.csv")


def test_json_has_everything_and_the_table_names_faults(folder, tmp_path, run):
    solve_own(*FINEST).save(tmp_path / "own.nc")
    with xr.open_dataset(tmp_path / "own.nc") as dataset:
        dataset.load().assign(multiplier=-dataset.multiplier).to_netcdf(tmp_path / "spoilt.nc")
    code, out, _ = run("score", folder, tmp_path / "spoilt.nc")
    assert (code, "spoilt.nc: the multiplier has the wrong sign" in out) == (1, True)
    code, out, _ = run("score", folder, tmp_path / "own.nc", "--json")
    assert code == 0
    document = json.loads(out)
    (record,) = document["solutions"]
    assert record["errors"]["h1"] == pytest.approx(solve_own(*FINEST).errors.h1, rel=1e-12)
    assert (record["level"], record["faults"], document["rates"]["h1"]["verdict"]) == (
        "level_2",
        [],
        "not judged",
    )
    dataset = record["conditions"]
    mu = solve_own(*FINEST).multiplier
    assert list(dataset) == ["of", "gap_least", "lambda_least", "product_largest"]
    assert dataset.pop("of") == "means over the cells"
    assert [list(value) for value in dataset.values()] == 3 * [["value", "place", "side"]]
    assert dataset["lambda_least"]["value"] == pytest.approx(mu.min(), abs=1e-12)


@pytest.mark.parametrize("page", ["own-solver", "command-line"])
def test_the_fields_of_the_conditions_are_documented(page):
    text = (ROOT / f"docs/{page}.md").read_text()
    extreme = Extreme(0.0, (0.0, 0.0), 0)
    names = Extremes(True, extreme, extreme, extreme).as_numbers()
    assert [name for name in (*names, *names["gap_least"]) if f"`{name}`" not in text] == []


@pytest.mark.parametrize(
    ("at_nodes", "where", "gap"),
    [(True, "at the nodes", "(u - g)"), (False, "over the cells", "mean(u - g)")],
)
def test_the_line_of_extremes_says_first_what_they_are_of(at_nodes, where, gap):
    values = [Extreme(value, (0.5, 0.0), 0) for value in (-1.0, 2.0, 3.0)]
    text = "at (0.5, 0) on side 0"
    message = f"{where}: min {gap} = -1 {text}, min lambda = 2 {text}, max |lambda {gap}| = 3 {text}"
    assert str(Extremes(at_nodes, *values)) == message


@pytest.mark.parametrize("name", ["../level_0", "/", "..", "", "level_0/..", 3, None])
@pytest.mark.parametrize("field", ["case", "folder"])
def test_names_that_lead_out_of_the_folder_are_refused(folder, tmp_path, refusal, field, name):
    """Before anything is opened; control: the folder as it is, in the other tests."""
    document = json.loads((folder / "problem.json").read_text())
    if field == "case":
        document["case"] = name
    else:
        document["levels"][1]["folder"] = name
    (tmp_path / "problem.json").write_text(json.dumps(document))
    for file in folder.iterdir():
        if file.name != "problem.json":
            (tmp_path / file.name).symlink_to(file)
    message = refusal("score", tmp_path, "u.csv")
    assert message.endswith(f"problem.json: {name!r} is not the name of a file in this folder\n")


def test_what_is_missing_for_a_rate_is_told(folder, tmp_path, run):
    """natural counts from h = 1/8 on; its finest level alone has no other, and u alone has no error in L2."""
    for name, sizes in LEVELS.items():
        solve_own(*sizes).save(tmp_path / f"{name}.vtu")
        solve_own(*sizes).save(tmp_path / f"{name}.csv")
    needed = "not judged: needs two levels with h <= 1/8 and H <= 1/4, whose h differ by a factor of 2"
    out = run("score", folder, tmp_path / "level_0.vtu", tmp_path / "level_2.vtu")[1]
    assert [line for line in out.splitlines() if line.startswith("rate")] == [
        f"rate in {norm:5} {needed}" for norm in ("h1", "hm12", "l2")
    ]
    for name in ("level_1", "level_2"):
        points = solve_own(*LEVELS[name]).mesh.points
        table = pd.DataFrame({"x": points[:, 0], "y": points[:, 1], "u": solve_own(*LEVELS[name]).u})
        table.to_csv(tmp_path / f"{name}.csv", index=False)
    out = run("score", folder, tmp_path / "level_1.csv", tmp_path / "level_2.csv")[1]
    assert re.search(r"^rate in h1    .* \(1 pair\), own .*, proved 1: reaches the proved rate$", out, re.M)
    assert "\nrate in l2    not judged: the errors are 0 or not known\n" in out


def test_a_level_that_is_handed_in_twice_is_told(folder, tmp_path, refusal):
    """Under one name or two."""
    for name in ("a.vtu", "b.vtu"):
        solve_own(*FINEST).save(tmp_path / name)
    for second in ("a.vtu", "b.vtu"):
        message = refusal("score", folder, tmp_path / "a.vtu", tmp_path / second)
        alternative = f"{tmp_path / second}: it is on level_2, as {tmp_path / 'a.vtu'} is"
        assert message == f"unilateral: {alternative}; hand in one solution for each level\n"


def test_where_no_rate_is_proved_none_is_printed():
    """Control: one that is proved."""
    by_norm = {"h1": Rate(0.91, 2, 0.92, np.nan), "l2": Rate(0.91, 1, 0.92, 1.0)}
    assert list(exchange._format_rates(load("natural").problem, [], by_norm)) == [
        "rate in h1    0.91 (2 pairs), own 0.92: no rate is proved",
        "rate in l2    0.91 (1 pair), own 0.92, proved 1: reaches the proved rate",
    ]


@pytest.mark.parametrize(("H", "report"), [("1/16", True), ("1/8", True), ("1/4", False)])
def test_cells_that_are_no_longer_than_edges_are_told(tmp_path, run, H, report):
    """The multiplier is then not unique, or may not be; control: H = 2h."""
    code, _, err = run("export", "natural", "--h", "1/8", "--H", H, "--levels", "2", "--out", tmp_path / "a")
    text = "unilateral: the multiplier may not be unique, because h >= H; take h < H, such as H = 2h\n"
    assert (code, err) == (0, text if report else "")
