"""A case as expressions in its coordinates: u, f, grad u, and on each side g, the gap and lambda = du/dn.

They are Python in x and y, or a module for numpy or UFL. Beside sin, cos and the like the expressions use
`pos` and `angle`, which `DEFINITIONS` and the modules define.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from fractions import Fraction
from functools import partial
from importlib import resources
from typing import Any

import numpy as np

from unilateral.arrays import Array
from unilateral.errors import InputError
from unilateral.formulas.derivative import derivative
from unilateral.formulas.exact_numbers import apply_function
from unilateral.formulas.expression import (
    ZERO,
    Expression,
    Primitive,
    primitive_expression,
    rational_expression,
    variable,
)
from unilateral.formulas.formula import FormulaEvaluation
from unilateral.problems.atoms import SmoothAtom, TensorAtom, X, Y, laplacian
from unilateral.problems.case import ExactSolution
from unilateral.problems.fields import join_sides
from unilateral.problems.polar_atoms import THETA, PolarAtom

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
"""Coordinates in a module of each kind, and the arguments of its functions."""
MAX_PRINTED_DENOMINATOR = 1024
"""Fractions with a denominator up to this are written as fractions."""
ClosedAtom = SmoothAtom | TensorAtom | PolarAtom
ROOT_EXPONENT = Fraction(1, 2)


def derive_case_formulas(
    case: ExactSolution, coordinates: tuple[str, str] = COORDINATES["python"]
) -> dict[str, Any]:
    """Formulas as text: `u`, `f` and the two of `grad_u`, and lists of `g`, `gap` and `lambda` per side.

    Each is None where the case has no closed formula. On clamped sides g is u, and gap and lambda are 0.
    """
    sides = range(case.polygon.n_sides)
    atoms = [atom for atom in case.atoms if isinstance(atom, ClosedAtom)]
    if len(atoms) < len(case.atoms):  # a Cantor atom is a sum without end
        per_side = {name: [None for _ in sides] for name in ("g", "gap", "lambda")}
        return {"u": None, "f": None, "grad_u": [None, None], **per_side}
    write = partial(_write_formula, coordinates=coordinates)
    # u is the sum of its atoms, f = -Delta u + u, or -Delta u if c = 0, and lambda = grad u . n
    u = sum(map(_atom_value, atoms), ZERO)
    source = sum(map(_atom_source, atoms), ZERO)
    f = source if case.c else source - u
    gaps = [_side_gap(case, side) for side in sides]
    fluxes = [
        ZERO if side in case.clamped_sides else _differentiate_sum(atoms, case.polygon.normals[side])
        for side in sides
    ]
    return {
        "u": write(u),
        "f": write(f),
        "grad_u": [write(_differentiate_sum(atoms, axis)) for axis in np.eye(2)],
        "g": [write(u - gap) for gap in gaps],
        "gap": list(map(write, gaps)),
        "lambda": list(map(write, fluxes)),
    }


def render_case_module(case: ExactSolution, kind: str) -> str:
    """A Python module of the case's functions, with numpy for the `kind` "python", else of UFL expressions.

    Raises InputError for a case without closed formulas.
    """
    formulas = derive_case_formulas(case, COORDINATES[kind])
    if formulas["u"] is None:
        raise InputError(f"case '{case.name}': {NO_FORMULAS}; 'unilateral export' writes f and g at points")
    template = resources.files("unilateral.exchange") / f"{kind}.template.txt"
    g = "".join(f"    lambda {ARGUMENTS[kind]}: {formula},\n" for formula in formulas["g"])
    flux = "".join(f"    lambda {ARGUMENTS[kind]}: {formula},\n" for formula in formulas["lambda"])
    return template.read_text(encoding="utf-8").format(
        name=case.name,
        title=case.title,
        polygon=case.polygon.name,
        equation="-lap u + u = f" if case.c else "-lap u = f",
        clamped=f", but u = g on the sides {join_sides(case.clamped_sides)}" if case.clamped_sides else "",
        vertices=case.polygon.vertices.tolist(),
        definitions=DEFINITIONS,
        u=formulas["u"],
        f=formulas["f"],
        grad_u=", ".join(formulas["grad_u"]),
        g=g,
        lambda_=flux,
    )


class _FormulaWriter(FormulaEvaluation):
    """A formula with its coordinates and unwieldy numbers as names, for its text."""

    def number(self, value: Fraction) -> Expression:
        """The number itself if it is a simple fraction, else a variable whose name has its decimal digits."""
        if value.denominator <= MAX_PRINTED_DENOMINATOR and abs(value.numerator) < 1 << 53:
            return rational_expression(value)
        return variable(repr(abs(float(value)))).scale(1 if value > 0 else -1)


def _write_formula(formula: Expression, coordinates: tuple[str, str]) -> str:
    """A formula in x and y as Python has it; numbers with all their digits."""
    names = {Primitive(old): variable(new) for old, new in zip("xy", coordinates, strict=True)}
    return str(_FormulaWriter((formula,), names).evaluate(formula))


def _as_fractions(values: Iterable[float]) -> list[Fraction]:
    return [Fraction(float(value)) for value in values]


def _convert_to_xy(atom: TensorAtom | PolarAtom, formula: Expression) -> Expression:
    """A formula in an atom's coordinates t, d or r, theta as one in x and y."""
    # t and d are coordinates of (x - centre)/length in the atom's frame; r and theta are polar ones
    a, b = _as_fractions(atom.centre)
    (p, q), (r, s) = map(_as_fractions, atom.frame)
    along = ((X - a) * p + (Y - b) * q) / Fraction(atom.length)
    into = ((X - a) * r + (Y - b) * s) / Fraction(atom.length)
    radius = (along**2 + into**2) ** ROOT_EXPONENT
    angle = primitive_expression(Primitive("angle", (into, along)))
    return _substitute(formula, {"t": along, "d": into, "r": radius, "theta": angle})


def _substitute(formula: Expression, values: Mapping[str, Expression]) -> Expression:
    """The formula with other formulas for its variables."""
    return FormulaEvaluation((formula,), {Primitive(name): value for name, value in values.items()}).evaluate(
        formula
    )


def _side_gap(case: ExactSolution, side: int) -> Expression:
    """The gap u - g on a side, in x and y; the case has it in t."""
    # t = (x - a) . tangent / length, the arc length from the side's start over the side's length
    (a, b) = _as_fractions(case.polygon.vertices[side])
    (p, q) = _as_fractions(case.polygon.tangents[side])
    t = ((X - a) * p + (Y - b) * q) / Fraction(case.polygon.lengths[side])
    return _substitute(case.gaps[side], {"t": t})


def _differentiate_sum(atoms: Iterable[ClosedAtom], direction: Array) -> Expression:
    """The derivative of the sum of some atoms in a direction."""
    return sum((_atom_derivative(atom, direction) for atom in atoms), ZERO)


def _atom_value(atom: ClosedAtom) -> Expression:
    """An atom u(x) = L v((x - centre)/L) in x and y, for a length L."""
    if isinstance(atom, SmoothAtom):
        return atom.u
    v = atom.derivatives[0] if isinstance(atom, PolarAtom) else atom.v
    return Fraction(atom.length) * _convert_to_xy(atom, v)


def _atom_source(atom: ClosedAtom) -> Expression:
    """Source -Delta u + u of an atom, with Delta u = (Delta v)/L."""
    if isinstance(atom, SmoothAtom):
        return atom.u - laplacian(atom.u, "x", "y")
    laplacian_v = atom.derivatives[3] if isinstance(atom, PolarAtom) else laplacian(atom.v, "t", "d")
    return _atom_value(atom) - _convert_to_xy(atom, laplacian_v) / Fraction(atom.length)


def _atom_derivative(atom: ClosedAtom, direction: Array) -> Expression:
    """Derivative of an atom in a direction, grad v . direction, as the lengths cancel."""
    n_x, n_y = _as_fractions(direction)
    if isinstance(atom, SmoothAtom):
        return derivative(atom.u, "x") * n_x + derivative(atom.u, "y") * n_y
    if isinstance(atom, TensorAtom):
        along = derivative(atom.v, "t")
        into = derivative(atom.v, "d")
    else:
        # v_t = v_r cos theta - (v_theta/r) sin theta, v_d = v_r sin theta + (v_theta/r) cos theta
        _, radial, angular, _ = atom.derivatives
        cos = apply_function("cos", THETA)
        sin = apply_function("sin", THETA)
        along = radial * cos - angular * sin
        into = radial * sin + angular * cos
    (along_x, along_y), (into_x, into_y) = map(_as_fractions, atom.frame)
    slope = along * (along_x * n_x + along_y * n_y) + into * (into_x * n_x + into_y * n_y)
    return _convert_to_xy(atom, slope)
