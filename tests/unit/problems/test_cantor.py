"""The Cantor set of transitions: its intervals, its atom against single ones, its gap."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
import sympy
import yaml
from sympy import Rational as Q

from unilateral.errors import InputError
from unilateral.fem.quadrature import boundary_rule, triangle_rules
from unilateral.formulas.formula import compile_numpy
from unilateral.geometry.polygon import Polygon, square
from unilateral.geometry.structured import structured
from unilateral.problems import case as cases
from unilateral.problems.atoms import Along
from unilateral.problems.cantor import DUST, Cantor, divided, gap
from unilateral.problems.case import Case
from unilateral.problems.certificate import certify
from unilateral.problems.harmonic import harmonic

KEEP = Q(9, 20)
LARGE = Polygon(2 * square().vertices, "large")


def test_the_intervals_of_the_first_generations_by_hand():
    odd, even, left = divided(KEEP, 2)
    assert odd == [(Q(9, 20), Q(11, 20))]
    assert even == [(Q(81, 400), Q(99, 400)), (Q(301, 400), Q(319, 400))]
    assert left == [(0, Q(81, 400)), (Q(99, 400), Q(9, 20)), (Q(11, 20), Q(301, 400)), (Q(319, 400), 1)]


@pytest.mark.parametrize("generations", [1, 2, 5, 8])
def test_the_intervals_tile_the_side(generations):
    """2^(g-1) are removed by generation g, 1 - 2 keep of what is there; (2 keep)^g is left."""
    odd, even, left = divided(KEEP, generations)
    ends = np.array(sorted([*odd, *even, *left]), dtype=float)
    np.testing.assert_allclose(ends[1:, 0], ends[:-1, 1], atol=1e-14)
    assert len(odd) + len(even) == 2**generations - 1
    assert sum(b - a for a, b in left) == (2 * KEEP) ** generations


@cache
def atom(generations=3, polygon=square()):  # noqa: B008
    return Cantor(polygon, 0, 0.0, KEEP, generations, Q(1, 2))


@cache
def singles(generations=3, polygon=square()):  # noqa: B008
    """The same as harmonic atoms, one a contact, each with the length of its contact as its cutoff."""
    return [harmonic(polygon, 0, a, Q(1, 2), b - a) for a, b in divided(KEEP, generations)[0]]


@pytest.mark.parametrize("polygon", [square(), LARGE], ids=["square", "large"])
def test_the_atom_is_the_sum_of_single_ones(polygon):
    rng = np.random.default_rng(0)
    points = polygon.lengths[0] * np.column_stack([rng.random(3000), 0.12 * rng.random(3000)])
    for name in ("value_and_gradient", "source"):
        found = getattr(atom(3, polygon), name)(points)
        expected = [getattr(each, name)(points) for each in singles(3, polygon)]
        if name == "source":
            np.testing.assert_allclose(found, sum(expected), atol=1e-12)
        else:
            np.testing.assert_allclose(found[0], sum(value for value, _ in expected), atol=1e-14)
            np.testing.assert_allclose(found[1], sum(slope for _, slope in expected), atol=1e-13)


def test_its_trace_and_flux_are_the_sums_too():
    t = np.linspace(0, 1, 2001)
    along = Along(t, t, 0 * t)
    found, expected = atom().trace_and_flux(0, along), [e.trace_and_flux(0, along) for e in singles()]
    np.testing.assert_allclose(found[0], sum(u for u, _ in expected), atol=1e-14)
    np.testing.assert_allclose(found[1], sum(flux for _, flux in expected), atol=1e-13)
    assert found[1].min() >= 0


def test_the_gap_by_hand():
    """The top of a tent of length l is l/4; a hundredth of it on what is left; the ends are linear."""
    value = compile_numpy([gap(KEEP, 2, Q(1, 20))], (sympy.Symbol("t", real=True),))
    t = np.array([0.0, 81 / 800, 81 / 400, 0.225, 99 / 400, 0.5 * (99 / 400 + 0.45), 0.45, 0.5, 0.55, 1.0])
    inner = float(DUST) * (0.45 - 99 / 400) / 4
    expected = [0.05, 0.025, 0, 18 / 400 / 4, 0, inner, 0, 0, 0, 0.05]
    np.testing.assert_allclose(value(t)[0], expected, atol=1e-15)


@cache
def load() -> Case:
    return cases.load("violates_jjj", square())


def test_the_certificate_says_that_there_are_infinitely_many():
    found = certify(load())
    assert found.hypotheses == {"j": True, "jj": True, "jjj": False}
    expected = np.array(sorted(divided(KEEP, 8)[0]), dtype=float)
    np.testing.assert_allclose([c[1:] for c in found.contact], expected, atol=1e-14)


def test_the_kept_intervals_are_shorter_than_a_quarter_of_the_finest_cell():
    """And those of the generation before are not: the declared truncation, for H = 1/128."""
    assert 0.45**8 < 1 / 128 / 4 < 0.45**7


@pytest.mark.parametrize("n", [12, 64])
def test_the_energy_by_green_s_formula(n):
    """To 1e-4, on meshes that see little and much of the set: f has a kink at every cutoff's end."""
    energy = load_of_u = 0.0
    for rule in triangle_rules(structured(square(), 1 / n), load()):
        u, du = load().value_and_gradient(rule.origin, rule.offset)
        energy += float(rule.weight.ravel() @ (np.sum(du**2, axis=1) + u**2))
        load_of_u += float(rule.weight.ravel() @ (load().source(rule.origin, rule.offset) * u))
    rule = boundary_rule(square(), square().starts, load().singular())
    u, flux, _ = load().boundary(rule.side, rule.s, rule.near)
    assert energy == pytest.approx(load_of_u + float(rule.weight @ (flux * u)), rel=1e-4)


@pytest.mark.parametrize("keep", ["1/2", "0", "3/4"])
def test_shares_that_leave_nothing_to_remove_are_refused(keep, tmp_path):
    declaration = cases.declared("violates_jjj")[0]
    declaration["u"][0]["keep"] = keep
    (tmp_path / "mine.yaml").write_text(yaml.safe_dump(declaration))
    with pytest.raises(InputError, match=r"keep: .* must lie between 0 and 1/2"):
        cases.load(tmp_path / "mine.yaml", square())
