"""Formulas as data: sums of products of powers, whose numbers are exact.

An `Expression` is a sum of terms, each a rational number times a product. A product has powers of variables,
functions and other sums, with rational exponents. Like terms and powers of one base are collected, and a
rational number multiplies every term of a sum; nothing else is multiplied out. Numbers that are not
rational, such as pi or sqrt(2), are expressions without variables.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property, lru_cache

Number = int | Fraction
MAX_TRIAL_DIVISOR = 1 << 10
"""Roots of a whole number are taken of each prime factor below this, and of the product of all others."""


class FormulaNode(ABC):
    """A part of a formula. Parts are equal if their keys are."""

    @property
    @abstractmethod
    def key(self) -> str:
        """A text that equal formulas share, by which they are compared and sorted."""

    @property
    @abstractmethod
    def variables(self) -> frozenset[str]:
        """The names of the variables in it."""

    def __eq__(self, node: object) -> bool:
        return isinstance(node, FormulaNode) and self.key == node.key

    def __hash__(self) -> int:
        return hash(self.key)


@dataclass(frozen=True, eq=False)
class Primitive(FormulaNode):
    """A variable, pi, or a function of expressions."""

    name: str
    args: tuple[Expression, ...] = ()

    @cached_property
    def key(self) -> str:
        """A text that equal primitives share."""
        return f"{self.name}({', '.join(arg.key for arg in self.args)})" if self.args else self.name

    @cached_property
    def variables(self) -> frozenset[str]:
        """The names of the variables in it."""
        if self.args or self.name == "pi":
            return frozenset().union(*(arg.variables for arg in self.args))
        return frozenset([self.name])

    def __str__(self) -> str:
        return f"{self.name}({', '.join(map(str, self.args))})" if self.args else self.name


@dataclass(frozen=True, eq=False)
class Expression(FormulaNode):
    """The sum of products times numbers; made by the functions below and by arithmetic."""

    terms: tuple[tuple[Product, Fraction], ...]

    @cached_property
    def key(self) -> str:
        """A text that equal sums share."""
        return " + ".join(f"{c}{_product_key(product)}" for product, c in self.terms)

    @cached_property
    def variables(self) -> frozenset[str]:
        """The names of the variables in it."""
        return frozenset().union(*(base.variables for product, _ in self.terms for base, _ in product))

    def __str__(self) -> str:
        """The formula as it may be typed: terms below 0 last, a rational number last of the others.

        >>> str(variable("x").scale(Fraction(3, 2)) - 5)
        '3*x/2 - 5'
        """
        terms = self.terms or (((), Fraction(0)),)
        first, *later = sorted(terms, key=lambda term: (term[1] < 0, not term[0]))
        signed = (f" {'-' if c < 0 else '+'} {_term_text(product, c)}" for product, c in later)
        return f"{'-' if first[1] < 0 else ''}{_term_text(*first)}{''.join(signed)}"

    @cached_property
    def rational(self) -> Fraction | None:
        """Its value if it is a rational number."""
        c, powers = self.factors
        return None if powers else c

    @property
    def factors(self) -> tuple[Fraction, Product]:
        """A number and powers whose product it is: 1 and the sum itself if it has several terms."""
        if len(self.terms) > 1:
            return Fraction(1), ((self, Fraction(1)),)
        return next(((c, product) for product, c in self.terms), (Fraction(0), ()))

    @cached_property
    def terms_by_variables(self) -> tuple[Expression, list[tuple[Expression, Product]]]:
        """The terms without variables; for every other term its factors without and with variables."""
        constant_terms = []
        variable_terms = []
        for product, c in self.terms:
            constants = tuple(power for power in product if not power[0].variables)
            variables = tuple(power for power in product if power[0].variables)
            constant_terms += [] if variables else [(product, c)]
            variable_terms += [(Expression(((constants, c),)), variables)] if variables else []
        return Expression(tuple(constant_terms)), variable_terms

    def scale(self, c: Number) -> Expression:
        """The sum with every term times the number c."""
        return sum_terms((product, c * coefficient) for product, coefficient in self.terms)

    def __add__(self, summand: Expression | Number) -> Expression:
        return sum_terms([*self.terms, *as_expression(summand).terms])

    def __neg__(self) -> Expression:
        return self.scale(-1)

    def __sub__(self, summand: Expression | Number) -> Expression:
        return self + -as_expression(summand)

    def __rsub__(self, summand: Number) -> Expression:
        return -self + summand

    def __mul__(self, factor: Expression | Number) -> Expression:
        (a, a_powers) = self.factors
        (b, b_powers) = as_expression(factor).factors
        return multiply_powers(a * b, [*a_powers, *b_powers])

    def __truediv__(self, divisor: Expression | Number) -> Expression:
        return self * as_expression(divisor) ** -1

    def __rtruediv__(self, dividend: Number) -> Expression:
        return self**-1 * dividend

    __radd__ = __add__
    __rmul__ = __mul__

    def __pow__(self, k: Number) -> Expression:
        """Raises ArithmeticError for a negative power of 0, and for a root of a negative rational number."""
        c, powers = self.factors
        powers_to_k = [(base, e * k) for base, e in powers]
        if Fraction(k).denominator == 1:
            return multiply_powers(c ** int(k), powers_to_k)
        if not powers and (c < 0 or c == 0 > k):
            raise ArithmeticError("no real number")
        # A root of c times powers is the root of c, by its prime factors, times theirs, if no sign is lost:
        # none is of a single base b, for c b >= 0 where the root is real
        if c > 0 and ([e for _, e in powers] == [1] or all(_is_exact_root(e, e * k) for _, e in powers)):
            return multiply_powers(1, [*_root_factors(c, Fraction(k)), *powers_to_k])
        # Else the power of the sum or product as a whole; 0 stays 0
        return multiply_powers(1, [(self, Fraction(k))]) if c else self


Power = tuple[Primitive | Expression, Fraction]
Product = tuple[Power, ...]
Subexpression = Expression | Power


def rational_expression(value: Number) -> Expression:
    """The expression of a rational number."""
    return sum_terms([((), Fraction(value))])


def as_expression(value: Expression | Number) -> Expression:
    """The expression of a number; an expression as it is."""
    return value if isinstance(value, Expression) else rational_expression(value)


def primitive_expression(primitive: Primitive) -> Expression:
    """The expression of a variable, pi or a function."""
    return multiply_powers(1, [(primitive, Fraction(1))])


@lru_cache(maxsize=64)
def variable(name: str) -> Expression:
    """The variable as an expression. It is made once, for each formula that is read asks for it."""
    return primitive_expression(Primitive(name))


def sum_terms(terms: Iterable[tuple[Product, Fraction]]) -> Expression:
    """The sum of products times numbers, in an order that does not depend on theirs."""
    collected: dict[Product, Fraction] = {}
    for product, c in terms:
        collected[product] = collected.get(product, Fraction(0)) + c
    nonzero = [(product, c) for product, c in collected.items() if c]
    return Expression(tuple(sorted(nonzero, key=lambda term: _product_key(term[0]))))


def _product_key(powers: Product) -> str:
    return "".join(f" ({base.key})^{k}" for base, k in powers)


def _term_text(factors: Product, c: Fraction) -> str:
    """A term without its sign, what has a negative exponent below the line; sums with variables last."""
    powers = sorted(factors, key=lambda power: isinstance(power[0], Expression) and bool(power[0].variables))
    above = [_power_text(base, k) for base, k in powers if k > 0]
    below = [_power_text(base, -k) for base, k in powers if k < 0]
    if abs(c.numerator) != 1 or not above:
        above = [str(abs(c.numerator)), *above]
    if c.denominator != 1:
        below = [str(c.denominator), *below]
    divisor = "*".join(below)
    return "*".join(above) + (f"/({divisor})" if len(below) > 1 else f"/{divisor}" if below else "")


def _power_text(base: Primitive | Expression, k: Fraction) -> str:
    if k == Fraction(1, 2):
        return f"sqrt({base})"
    is_simple = isinstance(base, Primitive) or str(base).isdecimal()
    text = str(base) if is_simple else f"({base})"
    return text if k == 1 else f"{text}**{k}" if k.denominator == 1 else f"{text}**({k})"


def multiply_powers(c: Number, powers: Iterable[Power]) -> Expression:
    """A number times powers; whole powers of roots and of single terms are carried out."""
    collected: dict[Primitive | Expression, Fraction] = {}
    c = Fraction(c)
    waiting = list(powers)
    # A power of a product is the product of powers; of a number its whole part is multiplied into c
    while waiting:
        base, k = waiting.pop()
        k += collected.pop(base, 0)
        if isinstance(base, Expression) and len(base.terms) == 1:
            times, inner = base.factors
            if not inner:
                c *= times ** (k // 1)
                k %= 1
            elif k.denominator == 1:
                c *= times ** int(k)
                waiting += [(factor, e * k) for factor, e in inner]
                continue
        if k:
            collected[base] = k
    # A number times a single sum multiplies each of its terms
    if len(collected) == 1 and c:
        ((base, k),) = collected.items()
        if k == 1 and isinstance(base, Expression) and len(base.terms) > 1:
            return base.scale(c)
    return sum_terms([(tuple(sorted(collected.items(), key=lambda power: power[0].key)), c)])


ZERO = rational_expression(0)
ONE = rational_expression(1)
PI = variable("pi")


@lru_cache(maxsize=1024)
def count_subexpressions(formulas: tuple[Expression, ...]) -> dict[Subexpression, int]:
    """The sums and powers that formulas are made of, outer ones first, and how often each occurs."""
    counts: dict[Subexpression, int] = {}
    waiting: list[Subexpression] = [*formulas]
    for subexpression in waiting:
        counts[subexpression] = counts.get(subexpression, 0) + 1
        if counts[subexpression] == 1:
            waiting += _direct_subexpressions(subexpression)
    return counts


def _direct_subexpressions(subexpression: Subexpression) -> list[Subexpression]:
    """The powers in a sum, the base of a power, the arguments of a function; (base, 1) is the base itself."""
    if isinstance(subexpression, Expression):
        return [power for product, _ in subexpression.terms for power in product]
    base, k = subexpression
    if k != 1:
        return [(base, Fraction(1))]
    return [base] if isinstance(base, Expression) else [*base.args]


def find_functions(e: Expression, name: str) -> list[Primitive]:
    """The functions of that name in an expression."""
    bases = dict.fromkeys(base for base, _ in _list_powers(e))
    return [base for base in bases if isinstance(base, Primitive) and base.name == name]


def find_fractional_powers(e: Expression) -> list[Power]:
    """The powers with variables whose exponents are no whole numbers."""
    return [(base, k) for base, k in _list_powers(e) if k.denominator > 1 and base.variables]


def _list_powers(e: Expression) -> list[Power]:
    """All powers of which an expression is made, outer ones first."""
    return [item for item in count_subexpressions((e,)) if not isinstance(item, Expression)]


def has_log(e: Expression) -> bool:
    """Whether there is a logarithm of what is not a number."""
    return any(log.variables for log in find_functions(e, "log"))


def hides_kink(e: Expression, k: Fraction) -> bool:
    """Whether e^k is the power of an absolute value, such as (x^2)^(1/2)."""
    # Even powers hide the signs of their bases, as in (x^2)^(1/2) = |x|, unless those of e^k are even, too
    exponents = [exponent for _, exponent in e.factors[1]]
    if not e.variables or any(exponent % 2 for exponent in exponents):
        return False
    return any(exponent * k % 2 for exponent in exponents)


def _is_exact_root(e: Fraction, result: Fraction) -> bool:
    """Whether a root of a base to the power e is the base to the power `result`."""
    # The base is >= 0 if e is a fraction; else its sign must count in neither of the two
    return e.denominator > 1 or (e % 2 == 0 and result % 2 == 0)


def _root_factors(c: Fraction, k: Fraction) -> list[Power]:
    """c^k for c > 0 as powers of whole numbers."""
    factors = [(n, sign * k) for n, sign in ((c.numerator, 1), (c.denominator, -1))]
    return [(rational_expression(p), e * times) for n, e in factors for p, times in _prime_factors(n)]


def _prime_factors(n: int) -> Iterator[tuple[int, int]]:
    """Prime factors below MAX_TRIAL_DIVISOR with their multiplicities, and what is left of n with 1."""
    for p in range(2, MAX_TRIAL_DIVISOR):
        if p * p > n:
            break
        times = 0
        while n % p == 0:
            n = n // p
            times = times + 1
        if times:
            yield p, times
    if n > 1:
        yield n, 1
