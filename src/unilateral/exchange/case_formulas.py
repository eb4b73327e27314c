"""A case as expressions in its coordinates: u, f, grad u, and on each side g, the gap and lambda = du/dn.

They are Python in x and y, or a module for numpy or UFL. Beside sin, cos and the like the expressions use
`pos` and `angle`, which `DEFINITIONS` and the modules define.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from fractions import Fraction
from importlib import resources
from typing import Any

import numpy as np

from unilateral.arrays import Array
from unilateral.errors import InputError
from unilateral.formulas.derivative import derivative
from unilateral.formulas.exact_numbers import apply
from unilateral.formulas.expression import ZERO, Atom, Expression, expression, number, variable
from unilateral.formulas.formula import Formulas
from unilateral.problems.atoms import Smooth, Tensor, X, Y, laplacian
from unilateral.problems.case import ExactSolution
from unilateral.problems.fields import listed
from unilateral.problems.polar_atoms import THETA, Polar

DEFINITIONS = (
    "from numpy import *\n"
    "def pos(a, k):  # the power a_+^k of the positive part\n"
    "    return where(a > 0, where(a > 0, a, 1.0) ** k, 0.0)\n"
    "def angle(b, a):  # of (a, b), in [0, 2 pi); b is 0 up to rounding on a side\n"
    "    return arctan2(where(abs(b) < 1e-12, abs(b), b), a) % (2 * pi)\n"
)
NO_FORMULAS = "there are no closed formulas, because u is a sum over the intervals of a Cantor set"
COORDINATES = {"python": ("x", "y"), "ufl": ("x[0]", "x[1]")}
ARGUMENTS = {"python": "x, y", "ufl": "x"}
"""COORDINATES is how a module of each kind writes coordinates, ARGUMENTS what its functions take."""
SIMPLE = 1024
"""Fractions with a denominator up to this are written as fractions."""
Closed = Smooth | Tensor | Polar
HALF = Fraction(1, 2)


def formulas(case: ExactSolution, coordinates: tuple[str, str] = COORDINATES["python"]) -> dict[str, Any]:
    """The formulas `u`, `f` and the two of `grad_u`, and `g`, `gap` and `lambda` per side.

    Each is None where the case has no closed formula. On clamped sides g is u, and gap and lambda are 0.
    """
    sides = range(case.polygon.n_sides)
    atoms = [atom for atom in case.atoms if isinstance(atom, Closed)]
    if len(atoms) < len(case.atoms):
        per_side = {name: [None for _ in sides] for name in ("g", "gap", "lambda")}
        return {"u": None, "f": None, "grad_u": [None, None], **per_side}
    u = sum((_value(atom) for atom in atoms), ZERO)
    f = sum((_source(atom) for atom in atoms), ZERO)
    gradient = [sum((_slope(atom, direction) for atom in atoms), ZERO) for direction in np.eye(2)]
    flux = [sum((_slope(atom, normal) for atom in atoms), ZERO) for normal in case.polygon.normals]
    flux = [ZERO if i in case.clamped_sides else flux[i] for i in sides]
    gap = []
    for i in sides:
        # t is the arc length from the side's start over the side's length
        (a, b) = _exact(case.polygon.vertices[i])
        (p, q) = _exact(case.polygon.tangents[i])
        t = ((X - a) * p + (Y - b) * q) / Fraction(case.polygon.lengths[i])
        gap.append(_with_values(case.gaps[i], {"t": t}))
    return {
        "u": _text(u, coordinates),
        "f": _text(f if case.c else f - u, coordinates),
        "grad_u": [_text(each, coordinates) for each in gradient],
        "g": [_text(u - each, coordinates) for each in gap],
        "gap": [_text(each, coordinates) for each in gap],
        "lambda": [_text(each, coordinates) for each in flux],
    }


def module(case: ExactSolution, kind: str) -> str:
    """A Python module of the case's functions, with numpy for the `kind` "python", else of UFL expressions.

    Raises InputError for a case without closed formulas.
    """
    found = formulas(case, COORDINATES[kind])
    if found["u"] is None:
        raise InputError(f"case '{case.name}': {NO_FORMULAS}; 'unilateral export' writes f and g at points")
    template = resources.files("unilateral.exchange") / f"{kind}.template.txt"
    g = "".join(f"    lambda {ARGUMENTS[kind]}: {each},\n" for each in found["g"])
    flux = "".join(f"    lambda {ARGUMENTS[kind]}: {each},\n" for each in found["lambda"])
    return template.read_text(encoding="utf-8").format(
        name=case.name,
        title=case.title,
        polygon=case.polygon.name,
        equation="-lap u + u = f" if case.c else "-lap u = f",
        clamped=f", but u = g on the sides {listed(case.clamped_sides)}" if case.clamped_sides else "",
        vertices=case.polygon.vertices.tolist(),
        definitions=DEFINITIONS,
        u=found["u"],
        f=found["f"],
        grad_u=", ".join(found["grad_u"]),
        g=g,
        lambda_=flux,
    )


class _Written(Formulas):
    """A formula with its coordinates and unwieldy numbers as names, for its text."""

    def number(self, value: Fraction) -> Expression:
        if value.denominator <= SIMPLE and abs(value.numerator) < 1 << 53:
            return number(value)
        return variable(repr(abs(float(value)))).scaled(1 if value > 0 else -1)


def _text(e: Expression, coordinates: tuple[str, str]) -> str:
    """A formula in x and y as Python has it; numbers with all their digits."""
    names = {Atom(old): variable(new) for old, new in zip("xy", coordinates, strict=True)}
    return str(_Written((e,), names).of(e))


def _exact(values: Iterable[float]) -> list[Fraction]:
    return [Fraction(float(value)) for value in values]


def _in_xy(atom: Tensor | Polar, e: Expression) -> Expression:
    """A formula in the atom's own coordinates, in x and y."""
    a, b = _exact(atom.centre)
    (p, q), (r, s) = map(_exact, atom.frame)
    along = ((X - a) * p + (Y - b) * q) / Fraction(atom.length)
    into = ((X - a) * r + (Y - b) * s) / Fraction(atom.length)
    radius = (along**2 + into**2) ** HALF
    angle = expression(Atom("angle", (into, along)))
    return _with_values(e, {"t": along, "d": into, "r": radius, "theta": angle})


def _with_values(e: Expression, values: Mapping[str, Expression]) -> Expression:
    """The formula with other formulas for its variables."""
    return Formulas((e,), {Atom(name): value for name, value in values.items()}).of(e)


def _value(atom: Closed) -> Expression:
    if isinstance(atom, Smooth):
        return atom.u
    v = atom.derived[0] if isinstance(atom, Polar) else atom.v
    return Fraction(atom.length) * _in_xy(atom, v)


def _source(atom: Closed) -> Expression:
    """-Delta u + u."""
    if isinstance(atom, Smooth):
        return atom.u - laplacian(atom.u, "x", "y")
    laplacian_v = atom.derived[3] if isinstance(atom, Polar) else laplacian(atom.v, "t", "d")
    return _value(atom) - _in_xy(atom, laplacian_v) / Fraction(atom.length)


def _slope(atom: Closed, direction: Array) -> Expression:
    """The derivative of u in a direction."""
    n_x, n_y = _exact(direction)
    if isinstance(atom, Smooth):
        return derivative(atom.u, "x") * n_x + derivative(atom.u, "y") * n_y
    if isinstance(atom, Tensor):
        along = derivative(atom.v, "t")
        into = derivative(atom.v, "d")
    else:
        _, radial, angular, _ = atom.derived
        cos = apply("cos", THETA)
        sin = apply("sin", THETA)
        along = radial * cos - angular * sin
        into = radial * sin + angular * cos
    (along_x, along_y), (into_x, into_y) = map(_exact, atom.frame)
    slope = along * (along_x * n_x + along_y * n_y) + into * (into_x * n_x + into_y * n_y)
    return _in_xy(atom, slope)
