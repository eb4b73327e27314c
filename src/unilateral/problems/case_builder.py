"""The atoms and the gaps of a case, from its declaration."""

from __future__ import annotations

import keyword
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from unilateral.errors import InputError, shown
from unilateral.formulas import formula
from unilateral.formulas.exact_numbers import rounded, sign
from unilateral.formulas.expression import Expression, atoms_in, has_log, roots_in
from unilateral.formulas.formula import kinks
from unilateral.formulas.grammar import FUNCTIONS, JUMP, KINK, MAX_DENOMINATOR, NO_LOG, NO_ROOT
from unilateral.geometry.polygon import Polygon
from unilateral.problems.atoms import Smooth, Tensor
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

    def formula(self, text: object, variables: str, where: str, least_power: int | None = JUMP) -> Expression:
        """A formula in variables of one letter each, with the values of the constants."""
        parsed = formula.parse(text, [*variables, *self.constants], where, least_power)
        return formula.substituted(parsed, self.constants, where)

    def along_side(self, text: object, where: str, least_power: int = KINK) -> Expression:
        """A formula in t whose kinks can be found."""
        of_t = self.formula(text, "t", where, least_power)
        if has_log(of_t):
            raise InputError(f"{where}: {NO_LOG}")
        if roots_in(of_t):
            raise InputError(f"{where}: {NO_ROOT}")
        try:
            kinks(of_t, "t")
        except ValueError as error:
            raise InputError(f"{where}: {error}") from None
        return of_t

    def side(self, offset: int) -> int:
        return (self.base + offset) % self.polygon.n_sides

    def atom(self, entry: Mapping[str, Any], where: str) -> Atom:
        if entry["atom"] == "smooth":
            u = self.formula(entry["formula"], "xy", where, least_power=None)
            if atoms_in(u, "pos") or has_log(u) or roots_in(u):
                raise InputError(f"{where}: a smooth atom has no pos, log or fractional power")
            return Smooth(u)
        side = entry["vertex"] if "vertex" in entry else self.side(entry["side"])
        if side >= self.polygon.n_sides:
            raise InputError(
                f"{where}, vertex: '{self.polygon.name}' has the vertices 0 to {self.polygon.n_sides - 1}"
            )
        if entry["atom"] == "tensor":
            profile = self.along_side(entry["profile"], f"{where}, profile", least_power=2)
            if any(k <= Fraction(3, 2) for _, k in kinks(profile, "t")):
                raise InputError(f"{where}, profile: its powers must be above 3/2, or f is not in L2")
            return Tensor(self.polygon, side, 0.0, profile, self._cutoff(entry, where))
        if entry["atom"] == "cantor":
            alpha = self._fraction(entry, "alpha", where)
            return Cantor(self.polygon, side, 0.0, self.family(entry, where), alpha)
        cutoff = self._cutoff(entry, where) if "cutoff" in entry else None
        times = formula.number(entry.get("times", 1), f"{where}, times")
        if entry["atom"] == "corner":
            power = self._fraction(entry, "alpha", where) if "alpha" in entry else None
            return corner(self.polygon, side, entry["kind"], power, cutoff, times)
        at = formula.number(entry["at"], f"{where}, at")
        if not 0 < rounded(at) < 1:
            raise InputError(f"{where}, at: {at} must lie between 0 and 1")
        alpha = self._fraction(entry, "alpha", where)
        return harmonic(self.polygon, side, rounded(at), alpha, cutoff, times)

    def _cutoff(self, entry: Mapping[str, Any], where: str) -> Expression:
        cutoff = formula.number(entry["cutoff"], f"{where}, cutoff")
        if sign(cutoff) <= 0:
            raise InputError(f"{where}, cutoff: {cutoff} must be positive")
        return cutoff

    def family(self, entry: Mapping[str, Any], where: str) -> Family:
        shares = {name: formula.fraction(entry[name], f"{where}, {name}") for name in ("keep", "inset")}
        for name, value in shares.items():
            if not 0 < value < Fraction(1, 2):
                raise InputError(f"{where}, {name}: {value} must lie between 0 and 1/2")
        return Family(shares["keep"], entry["generations"], shares["inset"])

    def _fraction(self, entry: Mapping[str, Any], name: str, where: str) -> Fraction:
        """The exponent in the field `name`, a simple fraction."""
        exponent = formula.fraction(entry[name], f"{where}, {name}")
        if exponent.denominator > MAX_DENOMINATOR:
            limit = f"a fraction, with a denominator of at most {MAX_DENOMINATOR}"
            raise InputError(f"{where}, {name}: {exponent} must be {limit}")
        return exponent

    def _cantor_gap(self, entry: Mapping[str, Any], where: str) -> Expression:
        gamma = self._fraction(entry, "gamma", where)
        if gamma <= 0:
            raise InputError(f"{where}, gamma: {gamma} must be positive")
        return cantor_gap(self.family(entry, where), gamma)

    def values(self, entries: Sequence[Mapping[str, Any]]) -> dict[int, Expression]:
        """What u is on clamped sides, in x and y."""
        found = {}
        for i, entry in enumerate(entries):
            found[self.side(entry["side"])] = self.formula(entry["u"], "xy", f"{self.where}, clamped[{i}]")
        return found

    def gaps(self, entry: Mapping[str, Any]) -> tuple[Expression, ...]:
        result = [self.along_side(entry["elsewhere"], f"{self.where}, gap.elsewhere")] * self.polygon.n_sides
        for i, item in enumerate(entry.get("sides", [])):
            place = f"{self.where}, gap.sides[{i}]"
            if "cantor" in item:
                gap = self._cantor_gap(item["cantor"], f"{place}, cantor")
            else:
                gap = self.along_side(item["formula"], place)
            result[self.side(item["side"])] = gap
        return tuple(result)
