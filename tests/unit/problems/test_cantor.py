"""The Cantor set of transitions: its intervals, its atom against single ones, its gap."""

from fractions import Fraction as Q
from functools import cache

import numpy as np
import pytest
import sentences
from conftest import load, load_certificate

from unilateral.errors import InputError
from unilateral.formulas.expression import rational_expression
from unilateral.formulas.formula import compile_numpy
from unilateral.geometry.polygon import Polygon, square
from unilateral.problems import case as cases
from unilateral.problems.atoms import SidePoints
from unilateral.problems.cantor_atom import UNREMOVED_GAP_FACTOR, CantorAtom, CantorSet, cantor_gap
from unilateral.problems.case_certificate import certify_case
from unilateral.problems.polar_atoms import make_harmonic_atom

KEEP = Q(9, 20)
LARGE = Polygon(2 * square().vertices, "large")
GAPS = {"cantor_2": 2, "cantor_1.5": 3 / 2, "violates_jjj": 1, "violates_jj_jjj": 1 / 2}
"""The cases, with the exponents of their gaps."""


def family(generations=3, keep=KEEP):
    return CantorSet(keep, generations, Q(1, 8))


def test_the_intervals_of_the_first_generations_by_hand():
    """1/8 + 3/4 t of those in [0, 1], which are 9/20 to 11/20, 81/400 to 99/400 and 301/400 to 319/400."""
    odd, even, remaining = family(2).sort_intervals()
    assert odd == [(Q(37, 80), Q(43, 80))]
    assert even == [(Q(443, 1600), Q(497, 1600)), (Q(1103, 1600), Q(1157, 1600))]
    assert [a for a, _ in remaining] == [Q(1, 8), even[0][1], odd[0][1], even[1][1]]
    assert [b for _, b in remaining] == [even[0][0], odd[0][0], even[1][0], Q(7, 8)]


@pytest.mark.parametrize("generations", [1, 2, 5, 7])
def test_the_intervals_tile_the_set_s_place(generations):
    """2^(g-1) are removed by generation g, 1 - 2 keep of what is there; (2 keep)^g is left."""
    odd, even, remaining = family(generations).sort_intervals()
    ends = np.array(sorted([*odd, *even, *remaining]), dtype=float)
    np.testing.assert_allclose(ends[1:, 0], ends[:-1, 1], rtol=0, atol=1e-14)
    assert len(odd) + len(even) == 2**generations - 1
    assert sum(b - a for a, b in remaining) == Q(3, 4) * Q(9, 10) ** generations


@pytest.mark.parametrize("keep", [Q(1, 3), Q(9, 20)])
def test_the_dimension_counts_intervals(keep):
    """l^{-d} kept intervals have the length l, up to a constant: of g generations 2^g of keep^g.

    Control: l^{-1} of them, as where nothing is removed, would be too many.
    """
    for generations in (3, 5):
        lengths = {b - a for a, b in family(generations, keep).sort_intervals()[2]}
        assert len(lengths) == 1
        size = float(lengths.pop() / Q(3, 4))
        assert size ** -family(1, keep).dimension == pytest.approx(2**generations, rel=1e-12)
        assert 1 / size > 1.1 * 2**generations


@pytest.mark.parametrize(("power", "keep"), [(Q(1, 3), Q(1, 3)), (Q(2), Q(1, 3)), (Q(1, 2), Q(9, 20))])
def test_the_order_is_where_the_norms_of_the_generations_stop_to_fall(power, keep):
    """Of s^k on an interval of the length l the seminorm in H^tau has the square c l^(2k + 1 - 2 tau).

    Their sums over a generation, from the intervals themselves, are a geometric series. Control: without the
    dimension, as for finitely many, the order would be higher, and there the sums grow.
    """
    order = family(5, keep).sobolev_order(power)
    removed = family(5, keep).sort_intervals()[0]
    lengths = np.array([b - a for a, b in removed], dtype=float)
    generations = [lengths[:1], lengths[1:5], lengths[5:]]

    def sums(tau):
        return [np.sum(generation ** (2 * float(power) + 1 - 2 * tau)) for generation in generations]

    assert sums(order - 0.01) == sorted(sums(order - 0.01), reverse=True)
    assert sums(order + 0.01) == sorted(sums(order + 0.01))
    assert sums(float(power) + 0.49) == sorted(sums(float(power) + 0.49))


@cache
def atom(generations=3, polygon=square()):  # noqa: B008
    return CantorAtom(polygon, 0, 0.0, family(generations), Q(1, 2))


@cache
def singles(generations=3, polygon=square()):  # noqa: B008
    """The same as harmonic atoms, one a contact, each with the length of its contact as its cutoff."""
    return [
        make_harmonic_atom(polygon, 0, float(a), Q(1, 2), rational_expression(b - a))
        for a, b in family(generations).sort_intervals()[0]
    ]


@pytest.mark.parametrize("polygon", [square(), LARGE], ids=["square", "large"])
def test_the_atom_is_the_sum_of_single_ones(polygon):
    rng = np.random.default_rng(0)
    points = polygon.lengths[0] * np.column_stack([rng.random(3000), 0.12 * rng.random(3000)])
    value_gradient = atom(3, polygon).value_gradient_and_source(points)
    expected = zip(*(single.value_gradient_and_source(points) for single in singles(3, polygon)), strict=True)
    for values, single_values, displaced in zip(value_gradient, expected, (1e-14, 1e-13, 1e-12), strict=True):
        np.testing.assert_allclose(values, sum(single_values), rtol=0, atol=displaced)


def test_the_trace_and_flux_of_the_atom_are_sums_of_single_ones():
    t = np.linspace(0, 1, 2001)
    along = SidePoints(t, t, 0 * t)
    trace = atom().trace_and_normal_flux(0, along)
    expected = [e.trace_and_normal_flux(0, along) for e in singles()]
    np.testing.assert_allclose(trace[0], sum(u for u, _ in expected), rtol=0, atol=1e-14)
    np.testing.assert_allclose(trace[1], sum(flux for _, flux in expected), rtol=0, atol=1e-13)
    assert trace[1].min() >= 0


@pytest.mark.parametrize("gamma", [Q(1), Q(3, 2), Q(2), Q(1, 2)])
def test_the_gap_has_the_tops_of_its_tents(gamma):
    """The top of a tent of length l is (l/4)^gamma, or a hundredth of it on what is left."""
    value = compile_numpy([cantor_gap(family(2), gamma)], "t")
    first = 443 / 1600
    second = 497 / 1600
    third = 37 / 80
    t = np.array([0, 1 / 16, 1 / 8, first, (first + second) / 2, (second + third) / 2, 0.5, 7 / 8, 1])
    tops = np.array([1 / 8, 1 / 16, 0, 0, (second - first) / 4, (third - second) / 4, 0, 0, 1 / 8]) ** float(
        gamma
    )
    tops[5] *= float(UNREMOVED_GAP_FACTOR)
    np.testing.assert_allclose(value(t)[0], tops, rtol=0, atol=1e-15)


@pytest.mark.parametrize("name", GAPS)
def test_the_certificate_says_that_there_are_infinitely_many(name):
    """Ends of contact are transitions; so are points in which two gaps meet, where lambda is 0.

    lambda is in H^sigma for sigma < 1/3 + (1 - d)/2, u - g in H^tau for tau < gamma + (1 - d)/2.
    """
    certificate = load_certificate(name)
    case = load(name)
    assert certificate.hypotheses == {"j": True, "jj": GAPS[name] >= 1, "jjj": False}
    assert certificate.g_regular == (GAPS[name] >= 3 / 2)
    d = np.log(2) / np.log(3)
    assert case.gap_order == pytest.approx(GAPS[name] + (1 - d) / 2, rel=1e-12)
    assert case.atoms[0].flux_order == pytest.approx(1 / 3 + (1 - d) / 2, rel=1e-12)
    expected = np.array(sorted(case.atoms[0].cantor_set.sort_intervals()[0]), dtype=float)
    np.testing.assert_allclose([c[1:] for c in certificate.contact], expected, rtol=0, atol=1e-14)
    transitions = np.round(case.transitions(), 12)
    assert np.isin(np.round([t for _, *pair in certificate.contact for t in pair], 12), transitions).all()


def test_u_is_not_in_H2_for_less_regular_fluxes(case_like):
    """Control: with alpha = 3/10 < d/2 = 0.315 lambda is not in H^(1/2)."""
    (entry,) = cases.read_case_declaration("violates_jjj")[0]["u"]
    with sentences.raises(InputError):
        certify_case(case_like("violates_jjj", u=[entry | {"alpha": "3/10"}]))


def test_the_kept_intervals_are_shorter_than_a_tenth_of_the_finest_cell():
    """And those of the generation before are not: the declared truncation, for H = 1/128."""
    (entry,) = cases.read_case_declaration("violates_jjj")[0]["u"]
    assert entry["generations"] == 7
    assert 3 / 4 / 3**7 < 1 / 128 / 10 < 3 / 4 / 3**6


@pytest.mark.parametrize(
    ("field", "share"), [("keep", "1/2"), ("keep", "0"), ("inset", "3/4"), ("inset", "0")]
)
def test_shares_that_leave_nothing_to_remove_are_refused(field, share, case_like):
    (entry,) = cases.read_case_declaration("violates_jjj")[0]["u"]
    with sentences.raises(InputError, field):
        case_like("violates_jjj", u=[entry | {field: share}])
    with sentences.raises(InputError, field):
        case_like("violates_jjj", u=[entry | {field: "sqrt(2)/3"}])


@pytest.mark.parametrize("gamma", ["0", "sqrt(2)"])
def test_a_gap_s_exponent_is_a_positive_fraction(gamma, case_like):
    declared = cases.read_case_declaration("violates_jjj")[0]["gap"]
    (side,) = declared["sides"]
    gaps = declared | {"sides": [side | {"cantor": side["cantor"] | {"gamma": gamma}}]}
    with sentences.raises(InputError):
        case_like("violates_jjj", gap=gaps)
