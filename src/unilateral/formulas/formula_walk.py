"""One walk through a formula, whatever its values are: arrays, Taylor models, intervals or formulas."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from fractions import Fraction
from functools import reduce
from operator import add
from typing import Any, Generic, TypeVar

from unilateral.formulas.expression import Expression, Power, Primitive, Subexpression, count_subexpressions

V = TypeVar("V", bound=Any)


class Evaluation(ABC, Generic[V]):
    """Computes the values of formulas from the `values` of the variables and of other primitives.

    Values may be of any kind that can be added. Those of subexpressions that occur more than once in the
    `formulas` are kept, to be used again.
    """

    def __init__(self, formulas: tuple[Expression, ...], values: Mapping[Primitive, V]) -> None:
        self.values = values
        self.counts = count_subexpressions(formulas)
        self.cache: dict[Subexpression, V] = {}

    @abstractmethod
    def number(self, value: Fraction) -> V:
        """The value of a rational number."""

    @abstractmethod
    def power(self, base: V, k: Fraction) -> V:
        """The power of a value, for k != 1."""

    @abstractmethod
    def function(self, primitive: Primitive) -> V:
        """The value of a primitive that is not among the `values`."""

    def product(self, a: V, b: V) -> V:
        """The product of two values."""
        return a * b

    def times(self, value: V, e: Expression) -> V:
        """A value times an expression without variables, which is not 1."""
        return self.product(value, self.evaluate(e))

    def constant(self, e: Expression) -> V:
        """The value of an expression without variables: the sum over its terms of c times the powers.

        Where one rounded number will do, subclasses replace this by it.
        """
        terms = (
            reduce(self.product, map(self._evaluate_power, powers), self.number(c)) for powers, c in e.terms
        )
        return reduce(add, terms, self.number(Fraction(0)))

    def evaluate(self, e: Expression) -> V:
        """The value of an expression."""
        return self._compute_once(e, self._evaluate_sum if e.variables else self.constant)

    def _evaluate_sum(self, e: Expression) -> V:
        """The sum of the terms with variables, and of those without as one constant."""
        fixed, varying = e.terms_by_variables
        terms = [self._evaluate_term(times, powers) for times, powers in varying]
        return reduce(add, [*terms, self.evaluate(fixed)] if fixed.terms else terms)

    def _evaluate_term(self, times: Expression, powers: Sequence[Power]) -> V:
        """The product of the powers, which have variables, times the factor without variables."""
        value = reduce(self.product, map(self._evaluate_power, powers))
        return value if times.rational == 1 else self.times(value, times)

    def _evaluate_power(self, power: Power) -> V:
        """The value of base^k, computed once."""
        return self._compute_once(power, self._compute_power)

    def _compute_power(self, power: Power) -> V:
        """The value of base^k; of base^1 that of the base, so that all powers of one base share it."""
        base, k = power
        if k != 1:
            return self.power(self._evaluate_power((base, Fraction(1))), k)
        if isinstance(base, Expression):
            return self.evaluate(base)
        return self.values[base] if base in self.values else self.function(base)

    def _compute_once(self, subexpression: Any, compute: Any) -> V:
        """The value by `compute`, which is kept if the subexpression occurs more than once."""
        if subexpression in self.cache:
            return self.cache[subexpression]
        value = compute(subexpression)
        if self.counts.get(subexpression, 0) > 1:
            self.cache[subexpression] = value
        return value
