"""The atoms and the gaps of a case, from its declaration."""

from __future__ import annotations

import keyword
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from unilateral.errors import InputError, quote_input
from unilateral.formulas import formula
from unilateral.formulas.exact_numbers import as_float, sign
from unilateral.formulas.expression import Expression, find_fractional_powers, find_functions, has_log
from unilateral.formulas.formula import find_kinks
from unilateral.formulas.grammar import (
    FUNCTION_ARITIES,
    JUMP_POWER,
    KINK_POWER,
    MAX_DENOMINATOR,
    NO_LOG,
    NO_ROOT,
)
from unilateral.geometry.polygon import Polygon
from unilateral.problems.atoms import SmoothAtom, TensorAtom
from unilateral.problems.cantor_atom import CantorAtom, CantorSet, cantor_gap
from unilateral.problems.polar_atoms import PolarAtom, make_corner_atom, make_harmonic_atom

RESERVED_NAMES = {"x", "y", "t", "pi", *FUNCTION_ARITIES}
CaseAtom = SmoothAtom | TensorAtom | PolarAtom | CantorAtom
CaseConstants = dict[str, Expression]


def read_constants(declaration: Mapping[str, Any], polygon: Polygon, where: str) -> CaseConstants:
    """The constants that a case declares, by name, for that polygon."""
    constants = {}
    for name, value in declaration.get("constants", {}).items():
        if isinstance(value, Mapping):
            if polygon.name not in value:
                raise InputError(f"{where}: the constant '{name}' has no value for '{polygon.name}'")
            value = value[polygon.name]
        _check_constant_name(name, where)
        constants[name] = formula.parse_number(value, f"{where}, constant {name}")
    return constants


def _check_constant_name(name: str, where: str) -> None:
    """Raises InputError unless Python allows the constant's name and nothing else has it."""
    if name in RESERVED_NAMES or keyword.iskeyword(name) or not re.fullmatch("[A-Za-z_][A-Za-z0-9_]*", name):
        fault = "cannot be a constant's name; take one such as c1 that formulas do not have"
        raise InputError(f"{where}, field constants: '{quote_input(name)}' {fault}")


@dataclass(frozen=True)
class CaseBuilder:
    """Reads the formulas of a case on a polygon, in which its constants stand by their names."""

    where: str
    polygon: Polygon
    base_side: int
    constants: CaseConstants

    def parse_formula(
        self, text: object, variables: str, where: str, least_power: int | None = JUMP_POWER
    ) -> Expression:
        """A formula in variables of one letter each, with the values of the constants."""
        parsed = formula.parse_formula(text, [*variables, *self.constants], where, least_power)
        return formula.substitute(parsed, self.constants, where)

    def parse_side_formula(self, text: object, where: str, least_power: int = KINK_POWER) -> Expression:
        """A formula in t whose kinks can be found."""
        parsed = self.parse_formula(text, "t", where, least_power)
        if has_log(parsed):
            raise InputError(f"{where}: {NO_LOG}")
        if find_fractional_powers(parsed):
            raise InputError(f"{where}: {NO_ROOT}")
        try:
            find_kinks(parsed, "t")
        except ValueError as error:
            raise InputError(f"{where}: {error}") from None
        return parsed

    def side_number(self, offset: int) -> int:
        """The side of the polygon at that offset from the base side."""
        return (self.base_side + offset) % self.polygon.n_sides

    def build_atom(self, entry: Mapping[str, Any], where: str) -> CaseAtom:
        """The atom that an entry of the field u declares."""
        if entry["atom"] == "smooth":
            u = self.parse_formula(entry["formula"], "xy", where, least_power=None)
            if find_functions(u, "pos") or has_log(u) or find_fractional_powers(u):
                raise InputError(f"{where}: a smooth atom has no pos, log or fractional power")
            return SmoothAtom(u)
        side = entry["vertex"] if "vertex" in entry else self.side_number(entry["side"])
        if side >= self.polygon.n_sides:
            raise InputError(
                f"{where}, vertex: '{self.polygon.name}' has the vertices 0 to {self.polygon.n_sides - 1}"
            )
        if entry["atom"] == "tensor":
            profile = self.parse_side_formula(entry["profile"], f"{where}, profile", least_power=2)
            if any(k <= Fraction(3, 2) for _, k in find_kinks(profile, "t")):
                raise InputError(f"{where}, profile: its powers must be above 3/2, or f is not in L2")
            return TensorAtom(self.polygon, side, 0.0, profile, self._read_cutoff(entry, where))
        if entry["atom"] == "cantor":
            alpha = self._read_exponent(entry, "alpha", where)
            return CantorAtom(self.polygon, side, 0.0, self.read_cantor_set(entry, where), alpha)
        # polar atoms: at a vertex, or at the point `at` of a side
        cutoff = self._read_cutoff(entry, where) if "cutoff" in entry else None
        times = formula.parse_number(entry.get("times", 1), f"{where}, times")
        if entry["atom"] == "corner":
            power = self._read_exponent(entry, "alpha", where) if "alpha" in entry else None
            return make_corner_atom(self.polygon, side, entry["kind"], power, cutoff, times)
        position = formula.parse_number(entry["at"], f"{where}, at")
        if not 0 < as_float(position) < 1:
            raise InputError(f"{where}, at: {position} must lie between 0 and 1")
        alpha = self._read_exponent(entry, "alpha", where)
        return make_harmonic_atom(self.polygon, side, as_float(position), alpha, cutoff, times)

    def _read_cutoff(self, entry: Mapping[str, Any], where: str) -> Expression:
        cutoff = formula.parse_number(entry["cutoff"], f"{where}, cutoff")
        if sign(cutoff) <= 0:
            raise InputError(f"{where}, cutoff: {cutoff} must be positive")
        return cutoff

    def read_cantor_set(self, entry: Mapping[str, Any], where: str) -> CantorSet:
        """The Cantor set with the fields keep, inset and generations."""
        shares = {name: formula.parse_fraction(entry[name], f"{where}, {name}") for name in ("keep", "inset")}
        for name, value in shares.items():
            if not 0 < value < Fraction(1, 2):
                raise InputError(f"{where}, {name}: {value} must lie between 0 and 1/2")
        return CantorSet(shares["keep"], entry["generations"], shares["inset"])

    def _read_exponent(self, entry: Mapping[str, Any], name: str, where: str) -> Fraction:
        """The exponent in the field `name`, a simple fraction."""
        exponent = formula.parse_fraction(entry[name], f"{where}, {name}")
        if exponent.denominator > MAX_DENOMINATOR:
            limit = f"a fraction, with a denominator of at most {MAX_DENOMINATOR}"
            raise InputError(f"{where}, {name}: {exponent} must be {limit}")
        return exponent

    def read_clamped_values(self, entries: Sequence[Mapping[str, Any]]) -> dict[int, Expression]:
        """u on the clamped sides, formulas in x and y by side."""
        values = {}
        for i, entry in enumerate(entries):
            place = f"{self.where}, clamped[{i}]"
            values[self.side_number(entry["side"])] = self.parse_formula(entry["u"], "xy", place)
        return values

    def build_gaps(self, entry: Mapping[str, Any]) -> tuple[Expression, ...]:
        """The gap u - g on every side, a formula in t."""
        elsewhere = self.parse_side_formula(entry["elsewhere"], f"{self.where}, gap.elsewhere")
        result = [elsewhere] * self.polygon.n_sides
        for i, item in enumerate(entry.get("sides", [])):
            place = f"{self.where}, gap.sides[{i}]"
            if "cantor" in item:
                place = f"{place}, cantor"
                gamma = self._read_exponent(item["cantor"], "gamma", place)
                if gamma <= 0:
                    raise InputError(f"{place}, gamma: {gamma} must be positive")
                gap = cantor_gap(self.read_cantor_set(item["cantor"], place), gamma)
            else:
                gap = self.parse_side_formula(item["formula"], place)
            result[self.side_number(item["side"])] = gap
        return tuple(result)
