"""One walk through a formula, whatever its values are: arrays, Taylor models, intervals or formulas."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from fractions import Fraction
from functools import reduce
from operator import add
from typing import Any, Generic, TypeVar

from unilateral.formulas.expression import Atom, Expression, Part, Power, parts_in

V = TypeVar("V", bound=Any)


class Evaluation(ABC, Generic[V]):
    """Computes the values of formulas from those of the variables and other `known` atoms.

    Values may be of any kind that can be added. Those of parts that occur more than once in the `formulas`
    are kept, to be used again.
    """

    def __init__(self, formulas: tuple[Expression, ...], known: Mapping[Atom, V]) -> None:
        self.known = known
        self.count = parts_in(formulas)
        self.kept: dict[Part, V] = {}

    @abstractmethod
    def number(self, value: Fraction) -> V: ...

    @abstractmethod
    def power(self, base: V, k: Fraction) -> V:
        """The power of a value, for k != 1."""

    @abstractmethod
    def function(self, of: Atom) -> V:
        """The value of an atom that is not known."""

    def product(self, a: V, b: V) -> V:
        return a * b

    def times(self, value: V, e: Expression) -> V:
        """A value times an expression without variables, which is not 1."""
        return self.product(value, self.of(e))

    def constant(self, e: Expression) -> V:
        """The value of an expression without variables."""
        terms = (
            reduce(self.product, (self._power(power) for power in of), self.number(c)) for of, c in e.terms
        )
        return reduce(add, terms, self.number(Fraction(0)))

    def of(self, e: Expression) -> V:
        return self._kept(e, self._total if e.variables else self.constant)

    def _total(self, e: Expression) -> V:
        fixed, varying = e.split
        parts = [self._term(times, of) for times, of in varying]
        return reduce(add, [*parts, self.of(fixed)] if fixed.terms else parts)

    def _term(self, times: Expression, of: Sequence[Power]) -> V:
        value = reduce(self.product, (self._power(power) for power in of))
        return value if times.rational == 1 else self.times(value, times)

    def _power(self, power: Power) -> V:
        return self._kept(power, self._raised)

    def _raised(self, power: Power) -> V:
        base, k = power
        if k != 1:
            return self.power(self._power((base, Fraction(1))), k)
        if isinstance(base, Expression):
            return self.of(base)
        return self.known[base] if base in self.known else self.function(base)

    def _kept(self, part: Any, read: Any) -> V:
        if part in self.kept:
            return self.kept[part]
        value = read(part)
        if self.count.get(part, 0) > 1:
            self.kept[part] = value
        return value
