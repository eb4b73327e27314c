"""What is guaranteed, each stated once, for problems with known solutions.

They are made by hand (`hand_made`), at random on random polygons (`random_problems`), or to fool whoever
certifies (`adversarial_problems`). `make fuzz` tries hundreds more of the last two, each told by its number.
"""

import os
from contextlib import contextmanager
from dataclasses import replace
from functools import lru_cache

import adversarial_problems
import numpy as np
import pytest
import random_problems
from hand_made import CASES, CRUDE, CatalogueSolution
from known_solutions import QUADRATURE, SIZE
from random_problems import make_random_problem

from unilateral.adaptive.goal import Goal
from unilateral.adaptive.loop import search
from unilateral.bounds import source
from unilateral.bounds.certain_contact import Verdict, find_certain_contact
from unilateral.bounds.clamped_ends import no_reactions
from unilateral.bounds.forces import bound_forces
from unilateral.bounds.local_bounds import local_bound
from unilateral.bounds.sharp_bounds import sharp_bound
from unilateral.discrete import solution
from unilateral.fem.form import Form
from unilateral.fem.p2 import boundary_layer

FUZZ = int(os.environ.get("UNILATERAL_FUZZ", "0"))
"""`make fuzz` sets how many times the problems are tried; those made to fool go on where the suite ends."""


def number_problems(kind, some, times=1):
    return [(kind, number) for number in (range(times * FUZZ) if FUZZ else some)]


OF_FORMULAS = number_problems("formula", (0, 4, 8, 20, 22, 26, 32, 39, 42, 48), 5)
FLUXES = number_problems("flux", (0, 1, 2, 7, 20), 2)
CORNERS = number_problems("corner", (1,))
SEARCHES = number_problems("formula", (4, 8, 22))
"""Random problems: all, or some that take about a second."""
MADE_TO_FOOL = [
    (family, number + (count if FUZZ else 0))
    for family, count in adversarial_problems.COUNTS.items()
    for number in range(FUZZ or count)
]
BY_HAND = [(*case, crude) for case in CASES for crude in CRUDE]
WITHOUT_CORNERS = [*BY_HAND, *OF_FORMULAS, *FLUXES, *MADE_TO_FOOL]
ALL = [*WITHOUT_CORNERS, *CORNERS]
CONTROLS = [("natural", "square", "noise"), ("formula", 4), ("peaks", 0)]
CERTAIN = number_problems("formula", (0, 4, 8, 20, 22, 26, 32), 5) + number_problems("flux", (0, 2, 7), 2)


PIECES = dict.fromkeys(random_problems.KINDS, 6000) | dict.fromkeys(adversarial_problems.FAMILIES, 20_000)
"""The most pieces of f by kind of problem; what takes more is known less well, and sooner."""


@contextmanager
def few_pieces(kind):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(source, "MAX_SOURCE_PIECES", PIECES.get(kind, source.MAX_SOURCE_PIECES))
        yield


@pytest.fixture(scope="module")
def known_case(request, tmp_path_factory):
    """One problem at a time, solved once for all tests of it."""
    kind, *parameters = request.param
    with few_pieces(kind):
        if kind in random_problems.KINDS:
            yield random_problems.try_kind(kind, *parameters, tmp_path_factory.mktemp("corner"))
        elif kind in adversarial_problems.FAMILIES:
            yield adversarial_problems.try_family(kind, *parameters)
        else:
            yield CatalogueSolution(kind, *parameters)


def parametrize_problems(problems):
    """A test of these problems; pytest runs all tests of one before those of the next."""
    ids = ["-".join(str(component) for component in key if component is not None) for key in problems]
    return pytest.mark.parametrize("known_case", problems, indirect=True, ids=ids, scope="module")


METHODS = [local_bound, sharp_bound]
BOUNDS = pytest.mark.parametrize("bound", METHODS)


@lru_cache(maxsize=len(METHODS))
def bounds(method, known_case):
    """A bound for each trial, computed once for all tests of a problem."""
    return [method(*trial.bound_arguments) for trial in known_case.trials]


def violations(known_case, bounds):
    """The trials in which a bound is too small."""
    return [
        (bound.u, trial.u_error, bound.lambda_, trial.lambda_error)
        for bound, trial in zip(bounds, known_case.trials, strict=True)
        if not (trial.u_error <= bound.u and trial.lambda_error <= bound.lambda_)
    ]


@parametrize_problems(ALL)
@BOUNDS
def test_no_bound_is_below_a_true_error(known_case, bound):
    """Whatever u_h and lambda_H are.

    Problems with many steep fluxes take some seconds to be solved on five meshes, and true errors on the
    L-shape, where u is singular, as long.
    """
    assert known_case.trials
    assert not violations(known_case, bounds(bound, known_case))


@pytest.mark.parametrize(
    ("known_case", "share"), [(CONTROLS[0], 0.6), (CONTROLS[1], 0.8)], indirect=["known_case"], scope="module"
)
@BOUNDS
@pytest.mark.parametrize("name", ["u", "lambda_"])
def test_a_bound_that_is_too_small_is_noticed(known_case, share, bound, name):
    """Control: all are nearer than that to some of the errors."""
    too_small = [
        replace(right, **{name: share * getattr(right, name)}) for right in bounds(bound, known_case)
    ]
    assert violations(known_case, too_small)


@parametrize_problems([("neumann", 0)])
@BOUNDS
def test_a_bound_without_what_f_h_leaves_is_noticed(known_case, bound):
    """Control: where peaks are not seen it is below errors."""

    def drop_f_h_errors(data):
        zero = np.zeros_like(data.source.remainder)
        return replace(data, source=replace(data.source, oscillation=zero, jumps=zero, remainder=zero))

    bounds = [
        bound(drop_f_h_errors(trial.bound_arguments[0]), *trial.bound_arguments[1:])
        for trial in known_case.trials
    ]
    assert violations(known_case, bounds)


@parametrize_problems(ALL)
def test_the_triangles_shares_add_up_to_the_squared_bound(known_case):
    """At most that, for squares of sums are more; at least a sixth, by Cauchy's inequality used twice.

    (a + b)^2 <= 2 (a^2 + b^2) for S and what tau~ leaves, (a + b + c)^2 <= 3 (..) for parts of the lifting.
    """
    for bound, trial in zip(bounds(local_bound, known_case), known_case.trials, strict=True):
        mesh = trial.bound_arguments[0].mesh
        assert np.all(bound.shares >= 0)
        # X^2 <= S^2 + 2 B + D^2 - max(D - eta, 0)^2
        maximum = bound.u**2 + max(mesh.exact_mesh_factor * bound.lift_norm - bound.eta, 0.0) ** 2
        assert bound.u**2 / 6 <= bound.shares.sum() * (1 + 1e-6) <= maximum * (1 + 2e-6)
        inside = np.delete(bound.shares, boundary_layer(mesh).triangles)
        assert inside.sum() <= maximum * (1 + 1e-6) - bound.lift_norm**2


def forces_outside(known_case, share=1.0):
    """Exact forces that do not lie between the numbers that are guaranteed; the `share` is of the bound."""
    wrong = []
    for force_case in known_case.force_trials:
        sides = no_reactions(force_case.mesh.polygon.n_sides)._replace(form=Form(free=tuple(force_case.free)))
        forces = bound_forces(
            force_case.mesh,
            force_case.cells,
            force_case.lambda_H,
            share * force_case.bound,
            force_case.side_groups,
            sides,
        )
        for component, force, (minimum, maximum) in zip(
            force_case.side_groups, forces, force_case.exact, strict=True
        ):
            if (
                force.upper < minimum
                or force.lower > maximum
                or not force.lower <= force.value <= force.upper
            ):
                wrong.append((component, force, minimum, maximum))
    return wrong


@parametrize_problems(WITHOUT_CORNERS)
def test_no_force_lies_outside(known_case):
    """Over the whole boundary and over each side."""
    assert not forces_outside(known_case)


@parametrize_problems(CONTROLS)
def test_a_force_outside_is_noticed(known_case):
    """Control: without what the error adds, exact forces lie outside."""
    assert forces_outside(known_case, share=0.0)


def list_contradictions(known_case, share=1.0):
    """Arcs that are called free where u = g at one of 800 points, or touching where it is above g at all.

    The `share` is of the bounds.
    """
    wrong = []
    for bound, trial in zip(bounds(local_bound, known_case), known_case.trials, strict=True):
        smaller = replace(bound, u=share * bound.u, lambda_=share * bound.lambda_, eta=share * bound.eta)
        for arc in find_certain_contact(*trial.bound_arguments, smaller):
            u, _, gap = known_case.known_solution.boundary(
                np.full(800, arc.side), np.linspace(arc.start, arc.end, 800)
            )
            touches = gap.min() <= 1e-9 * np.abs(u).max()
            if (arc.verdict is Verdict.FREE and gap.min() <= 0) or (
                arc.verdict is Verdict.TOUCHES and not touches
            ):
                wrong.append(arc)
    return wrong


@parametrize_problems(CERTAIN)
def test_no_arc_is_certain_against_the_exact_solution(known_case):
    """Whatever u_h and lambda_H are, on uniform and on adapted meshes."""
    assert not list_contradictions(known_case)


@parametrize_problems([("formula", 8)])
def test_an_arc_that_is_certain_wrongly_is_noticed(known_case):
    """Control: without what the error adds, contact is called free where u_h is too high."""
    assert list_contradictions(known_case, share=0.0)


def judged_search(problem, accuracy, maximum):
    """A search, and whether what it certifies is as accurate: by the norm of u itself, not known to it."""
    result = search(problem.problem, Goal(accuracy, max_unknowns=maximum))
    solved = result.best.solved
    error, norm = problem.errors(solved.mesh, [solved.u_h, np.zeros_like(solved.u_h)])
    assert result.best.size <= norm * (1 + QUADRATURE)
    assert result.certified == (result.ended == "")
    return result.certified, error <= accuracy * norm * (1 + QUADRATURE)


@pytest.mark.parametrize(("kind", "number"), SEARCHES)
def test_what_is_certified_is_as_accurate_as_that(kind, number):
    """With 1000 unknowns some of hundreds of problems are out of reach."""
    accuracy = 10.0 ** np.random.default_rng([18, number]).uniform(-1.5, -0.3)
    with few_pieces(kind):
        certified, accurate = judged_search(make_random_problem(number), accuracy, 1000)
    assert accurate or not certified
    assert certified or FUZZ


@pytest.mark.parametrize("family", ["kinks", "sides", "large"])
def test_most_problems_are_certified_on_finer_meshes(family):
    """To refuse everything would be easy."""
    with few_pieces(family):
        assert judged_search(adversarial_problems.make_adversarial_problem(family, 0), 0.05, 10_000) == (
            True,
            True,
        )


def test_a_certificate_that_is_wrong_is_noticed(monkeypatch):
    """Control: by a tenth of the bound a search ends too early."""

    def too_small(*arguments):
        right = local_bound(*arguments)
        return replace(right, u=0.1 * right.u)

    monkeypatch.setattr(solution, "local_bound", too_small)
    assert judged_search(make_random_problem(8), 0.1, 1000) == (True, False)


@parametrize_problems(OF_FORMULAS)
def test_the_quadrature_of_the_true_error_is_as_accurate_as_assumed(known_case):
    """Pieces of half the size, which have a quarter of its error at most, change it by less."""
    manufactured = known_case.known_solution
    (solved, _) = known_case.solutions[0]
    mesh = solved.mesh
    functions = [solved.u_h, np.zeros_like(solved.u_h)]
    (coarse, norm) = manufactured.errors(mesh, functions, SIZE)
    (fine, _) = manufactured.errors(mesh, functions, SIZE / 2)
    assert coarse == pytest.approx(fine, rel=0.75 * QUADRATURE, abs=1e-12 * norm)


@parametrize_problems([*OF_FORMULAS, *FLUXES, *CORNERS])
def test_the_random_solutions_solve_their_problems(known_case):
    """(1.2) in points of the boundary, up to rounding; (1.1) is how f is made."""
    manufactured = known_case.known_solution
    lengths = manufactured.problem.polygon.lengths
    per_side = 200
    side = np.repeat(np.arange(len(lengths)), per_side)
    s = lengths[side] * np.tile((np.arange(per_side) + 0.5) / per_side, len(lengths))
    u, flux, gap = manufactured.boundary(side, s)
    size = np.abs(u).max()
    u_tolerance = 1e-12 * size
    flux_tolerance = 1e-9 * max(size / lengths.min(), np.abs(flux).max())
    assert gap.min() >= -u_tolerance
    assert flux.min() >= -flux_tolerance
    assert not np.any((gap > u_tolerance) & (flux > flux_tolerance))
