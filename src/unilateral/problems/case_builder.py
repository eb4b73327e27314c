"""The atoms and the gaps of a case, from its declaration."""

from __future__ import annotations

import keyword
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import sympy

from unilateral.errors import InputError, shown
from unilateral.formulas import formula
from unilateral.formulas.expression import Expression, has_log, roots_in
from unilateral.formulas.grammar import FUNCTIONS, KINK, MAX_DENOMINATOR, NO_LOG, NO_ROOT
from unilateral.formulas.symbolic import kinks, number_of, plain, pos, symbolic
from unilateral.geometry.polygon import Polygon
from unilateral.problems.atoms import Smooth, T, Tensor, X, Y
from unilateral.problems.cantor_atom import Cantor, Family
from unilateral.problems.cantor_atom import gap as cantor_gap
from unilateral.problems.polar_atoms import Polar, corner, harmonic

RESERVED = {"x", "y", "t", "pi", *FUNCTIONS}
Atom = Smooth | Tensor | Polar | Cantor
Constants = dict[str, Expression]


def constants_of(declaration: Mapping[str, Any], polygon: Polygon, where: str) -> Constants:
    constants = {}
    for name, value in declaration.get("constants", {}).items():
        if isinstance(value, Mapping):
            if polygon.name not in value:
                raise InputError(f"{where}: the constant '{name}' has no value for '{polygon.name}'")
            value = value[polygon.name]
        _check_name(name, where)
        constants[name] = formula.number(value, f"{where}, constant {name}")
    return constants


def _check_name(name: str, where: str) -> None:
    """Raises InputError unless Python allows the constant's name and nothing else has it."""
    if name in RESERVED or keyword.iskeyword(name) or not re.fullmatch("[A-Za-z_][A-Za-z0-9_]*", name):
        fault = "cannot be a constant's name; take one such as c1 that formulas do not have"
        raise InputError(f"{where}, field constants: '{shown(name)}' {fault}")


@dataclass(frozen=True)
class Builder:
    where: str
    polygon: Polygon
    base: int
    constants: Constants

    def formula(
        self, text: object, variables: tuple[sympy.Symbol, ...], where: str, least_power: int | None = None
    ) -> sympy.Expr:
        names = [*(symbol.name for symbol in variables), *self.constants]
        parsed = formula.parse(text, names, where, least_power)
        return symbolic(formula.substituted(parsed, self.constants, where))

    def along_side(self, text: object, where: str, least_power: int = KINK) -> sympy.Expr:
        """A formula in t whose kinks can be found."""
        of_t = self.formula(text, (T,), where, least_power)
        if has_log(plain(of_t)):
            raise InputError(f"{where}: {NO_LOG}")
        if roots_in(plain(of_t)):
            raise InputError(f"{where}: {NO_ROOT}")
        try:
            kinks(of_t, T)
        except ValueError as error:
            raise InputError(f"{where}: {error}") from None
        return of_t

    def side(self, offset: int) -> int:
        return (self.base + offset) % self.polygon.n_sides

    def atom(self, entry: Mapping[str, Any], where: str) -> Atom:
        if entry["atom"] == "smooth":
            u = self.formula(entry["formula"], (X, Y), where)
            if u.has(pos, sympy.log) or any(not power.exp.is_integer for power in u.atoms(sympy.Pow)):
                raise InputError(f"{where}: a smooth atom has no pos, log or fractional power")
            return Smooth(u)
        side = entry["vertex"] if "vertex" in entry else self.side(entry["side"])
        if side >= self.polygon.n_sides:
            raise InputError(
                f"{where}, vertex: '{self.polygon.name}' has the vertices 0 to {self.polygon.n_sides - 1}"
            )
        cutoff = number_of(entry["cutoff"], f"{where}, cutoff") if "cutoff" in entry else None
        if cutoff is not None and cutoff <= 0:
            raise InputError(f"{where}, cutoff: {cutoff} must be positive")
        if entry["atom"] == "tensor":
            profile = self.along_side(entry["profile"], f"{where}, profile", least_power=2)
            if any(k <= Fraction(3, 2) for _, k in kinks(profile, T)):
                raise InputError(f"{where}, profile: its powers must be above 3/2, or f is not in L2")
            return Tensor(self.polygon, side, 0.0, profile, cutoff)
        times = number_of(entry.get("times", 1), f"{where}, times")
        alpha = self._fraction(entry, "alpha", where) if "alpha" in entry else None
        if entry["atom"] == "cantor":
            return Cantor(self.polygon, side, 0.0, self.family(entry, where), alpha)
        if entry["atom"] == "corner":
            return corner(self.polygon, side, entry["kind"], alpha, cutoff, times)
        at = number_of(entry["at"], f"{where}, at")
        if not 0 < at < 1:
            raise InputError(f"{where}, at: {at} must lie between 0 and 1")
        return harmonic(self.polygon, side, at, alpha, cutoff, times)

    def family(self, entry: Mapping[str, Any], where: str) -> Family:
        keep, inset = (number_of(entry[name], f"{where}, {name}") for name in ("keep", "inset"))
        for name, value in (("keep", keep), ("inset", inset)):
            if not 0 < value < sympy.Rational(1, 2):
                raise InputError(f"{where}, {name}: {value} must lie between 0 and 1/2")
        return Family(keep, entry["generations"], inset)

    def _fraction(self, entry: Mapping[str, Any], name: str, where: str) -> sympy.Expr:
        """The exponent in the field `name`, a simple fraction."""
        exponent = number_of(entry[name], f"{where}, {name}")
        if not (exponent.is_Rational and exponent.q <= MAX_DENOMINATOR):
            limit = f"a fraction, with a denominator of at most {MAX_DENOMINATOR}"
            raise InputError(f"{where}, {name}: {exponent} must be {limit}")
        return exponent

    def _cantor_gap(self, entry: Mapping[str, Any], where: str) -> sympy.Expr:
        gamma = self._fraction(entry, "gamma", where)
        if gamma <= 0:
            raise InputError(f"{where}, gamma: {gamma} must be positive")
        return cantor_gap(self.family(entry, where), gamma)

    def values(self, entries: Sequence[Mapping[str, Any]]) -> dict[int, Expression]:
        """What u is on clamped sides, in x and y."""
        found = {}
        for i, entry in enumerate(entries):
            place = f"{self.where}, clamped[{i}]"
            parsed = formula.parse(entry["u"], ["x", "y", *self.constants], place)
            found[self.side(entry["side"])] = formula.substituted(parsed, self.constants, place)
        return found

    def gaps(self, entry: Mapping[str, Any]) -> tuple[sympy.Expr, ...]:
        result = [self.along_side(entry["elsewhere"], f"{self.where}, gap.elsewhere")] * self.polygon.n_sides
        for i, item in enumerate(entry.get("sides", [])):
            place = f"{self.where}, gap.sides[{i}]"
            if "cantor" in item:
                gap = self._cantor_gap(item["cantor"], f"{place}, cantor")
            else:
                gap = self.along_side(item["formula"], place)
            result[self.side(item["side"])] = gap
        return tuple(result)
