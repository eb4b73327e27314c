"""The real roots of polynomials with rational coefficients, by Sturm's theorem: none is missed."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from itertools import pairwise
from math import ceil, inf, lcm

Polynomial = list[Fraction]
"""The coefficients, that of the highest power first, which is not 0; none for the polynomial 0."""
ROOT_BITS = 64
"""The ends of an interval about a root agree in this many bits."""


def real_roots(coefficients: Sequence[Fraction]) -> list[float]:
    """The real roots of a polynomial, each once and in ascending order; infinite if too large.

    The highest power's coefficient comes first, and is not 0.
    """
    roots = []
    polynomial = [*coefficients]
    while polynomial[-1] == 0:
        roots = [0.0]
        polynomial = polynomial[:-1]
    degree = len(polynomial) - 1
    # Fujiwara: no root is larger than 2 max |c_i / c_0|^(1 / i); so those of p(scale x) are in (-1, 1]
    bits = [_log2_bound(c / polynomial[0]) / i for i, c in enumerate(polynomial) if i and c]
    scale = Fraction(2) ** (1 + ceil(max(bits, default=0)))
    chain = _sturm_chain([c * scale ** (degree - i) for i, c in enumerate(polynomial)])
    # (n, k) is the interval from n / 2^k, without it, to (n + 1) / 2^k
    intervals = [(-1, 0), (0, 0)]
    while intervals:
        n, k = intervals.pop()
        # Sturm: the number of roots in an interval is that of the sign changes that are lost
        if _sign_changes(chain, n, k) == _sign_changes(chain, n + 1, k):
            continue
        # n of more than ROOT_BITS bits: both ends agree in so many; the upper one may be the root
        if abs(n) >> ROOT_BITS:
            roots.append(_float_or_inf(scale * Fraction(n + 1, 1 << k)))
        else:
            intervals += [(2 * n, k + 1), (2 * n + 1, k + 1)]
    return sorted(roots)


def _log2_bound(x: Fraction) -> int:
    """A whole number above log2 |x|."""
    return x.numerator.bit_length() - x.denominator.bit_length() + 1


def _sturm_chain(polynomial: Polynomial) -> list[list[int]]:
    """p, p' and the negative remainders after them, over their greatest common divisor.

    So multiple roots become simple, and the theorem holds at every place. Positive factors, which change no
    sign, make the coefficients whole.
    """
    # p_0 = p, p_1 = p', p_(i + 1) = -(p_(i - 1) mod p_i), up to positive factors; the last one before the
    # polynomial 0 is the greatest common divisor
    degree = len(polynomial) - 1
    chain = [polynomial, [c * (degree - i) for i, c in enumerate(polynomial[:-1])]]
    while chain[-1]:
        remainder = _divide_polynomials(chain[-2], chain[-1])[1]
        chain.append([-c / abs(remainder[0]) for c in remainder])
    quotients = [_divide_polynomials(p, chain[-2])[0] for p in chain[:-1]]
    multiples = [lcm(*(c.denominator for c in p)) for p in quotients]
    return [[int(c * m) for c in p] for p, m in zip(quotients, multiples, strict=True)]


def _divide_polynomials(dividend: Polynomial, divisor: Polynomial) -> tuple[Polynomial, Polynomial]:
    """The quotient and the remainder."""
    quotient = []
    remainder = [*dividend]
    while len(remainder) >= len(divisor):
        factor = remainder[0] / divisor[0]
        quotient.append(factor)
        for i, c in enumerate(divisor):
            remainder[i] -= factor * c
        # its highest power is now 0; others may be, too
        remainder = remainder[1:]
    while remainder and remainder[0] == 0:
        remainder = remainder[1:]
    return quotient, remainder


def _sign_changes(chain: list[list[int]], n: int, k: int) -> int:
    """How often the sign changes along the chain at n / 2^k, zeros left out."""
    positive = []
    for polynomial in chain:
        value = 0  # 2^(k degree) times that of the polynomial, by Horner's rule
        for i, c in enumerate(polynomial):
            value = value * n + (c << k * i)
        positive += [value > 0] if value else []
    return sum(a != b for a, b in pairwise(positive))


def _float_or_inf(x: Fraction) -> float:
    """The number rounded, infinite with its sign if it is too large."""
    try:
        return float(x)
    except OverflowError:
        return inf if x > 0 else -inf
