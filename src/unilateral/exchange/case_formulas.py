"""A case as expressions in its coordinates: u, f, grad u, and on each side g, the gap and lambda = du/dn.

They are Python in x and y, or a module for numpy or UFL. Beside sin, cos and the like the expressions use
`pos` and `angle`, which `DEFINITIONS` and the modules define.
"""

from __future__ import annotations

from importlib import resources
from typing import Any

import sympy

from unilateral.errors import InputError
from unilateral.problems.atoms import D, Smooth, T, Tensor, X, Y
from unilateral.problems.case import ExactSolution
from unilateral.problems.fields import listed
from unilateral.problems.polar_atoms import THETA, Polar, R

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
ANGLE = sympy.Function("angle", real=True)


def formulas(case: ExactSolution, coordinates: tuple[str, str] = COORDINATES["python"]) -> dict[str, Any]:
    """The formulas `u`, `f` and the two of `grad_u`, and `g`, `gap` and `lambda` per side.

    Each is None where the case has no closed formula. On clamped sides g is u, and gap and lambda are 0.
    """
    sides = range(case.polygon.n_sides)
    atoms = [atom for atom in case.atoms if isinstance(atom, Closed)]
    if len(atoms) < len(case.atoms):
        per_side = {name: [None for _ in sides] for name in ("g", "gap", "lambda")}
        return {"u": None, "f": None, "grad_u": [None, None], **per_side}
    u, f = (sympy.Add(*map(of, atoms)) for of in (_value, _source))
    f = f if case.reaction else f - u
    gradient, flux = (
        [sympy.Add(*(_flux(atom, *direction) for atom in atoms)) for direction in directions]
        for directions in (((1.0, 0.0), (0.0, 1.0)), case.polygon.normals)
    )
    flux = [sympy.S.Zero if i in case.clamped_sides else flux[i] for i in sides]
    gap = [case.gaps[i].xreplace({T: _along(case, i)}) for i in sides]
    found = {"u": u, "f": f, "grad_u": gradient, "g": [u - each for each in gap], "gap": gap, "lambda": flux}
    names = dict(zip((X, Y), sympy.symbols(coordinates), strict=True))
    return {
        name: [_text(each, names) for each in value] if isinstance(value, list) else _text(value, names)
        for name, value in found.items()
    }


def module(case: ExactSolution, kind: str) -> str:
    """A Python module of the case's functions, with numpy for the `kind` "python", else of UFL expressions.

    Raises InputError for a case without closed formulas.
    """
    found = formulas(case, COORDINATES[kind])
    if found["u"] is None:
        raise InputError(f"case '{case.name}': {NO_FORMULAS}; 'unilateral export' writes f and g at points")
    template = resources.files("unilateral.exchange") / f"{kind}.template.txt"
    g, flux = (
        "".join(f"    lambda {ARGUMENTS[kind]}: {each},\n" for each in found[name])
        for name in ("g", "lambda")
    )
    return template.read_text(encoding="utf-8").format(
        name=case.name,
        title=case.title,
        polygon=case.polygon.name,
        equation="-lap u + u = f" if case.reaction else "-lap u = f",
        clamped=f", but u = g on the sides {listed(case.clamped_sides)}" if case.clamped_sides else "",
        vertices=case.polygon.vertices.tolist(),
        definitions=DEFINITIONS,
        u=found["u"],
        f=found["f"],
        grad_u=", ".join(found["grad_u"]),
        g=g,
        lambda_=flux,
    )


def _text(expression: sympy.Expr, names: dict[sympy.Symbol, sympy.Symbol]) -> str:
    """An expression as Python has it; numbers with all their digits."""
    return str(sympy.sstr(expression.xreplace(names), full_prec=True))


def _along(case: ExactSolution, side: int) -> sympy.Expr:
    """t, the arc length from the side's start over the length of the side."""
    (a, b), (p, q) = case.polygon.vertices[side], case.polygon.tangents[side]
    s = (X - _number(a)) * _number(p) + (Y - _number(b)) * _number(q)
    return s / _number(case.polygon.lengths[side])


def _number(value: float) -> sympy.Expr:
    """A number, exactly; a simple fraction is written as a fraction."""
    numerator, denominator = float(value).as_integer_ratio()
    simple = denominator <= SIMPLE
    return sympy.Rational(numerator, denominator) if simple else sympy.Float(float(value), 17)


def _local(atom: Tensor | Polar) -> dict[sympy.Expr, sympy.Expr]:
    """The atom's own coordinates in x and y."""
    shifted = [z - _number(centre) for z, centre in zip((X, Y), atom.centre, strict=True)]
    along, into = (
        sympy.Add(*(z * _number(e) for z, e in zip(shifted, row, strict=True))) / _number(atom.length)
        for row in atom.frame
    )
    return {T: along, D: into, R: sympy.sqrt(along**2 + into**2), THETA: ANGLE(into, along)}


def _value(atom: Closed) -> sympy.Expr:
    if isinstance(atom, Smooth):
        return atom.u
    v = atom.symbolic[0] if isinstance(atom, Polar) else atom.v
    return _number(atom.length) * v.xreplace(_local(atom))


def _source(atom: Closed) -> sympy.Expr:
    if isinstance(atom, Smooth):
        return atom.u - sympy.diff(atom.u, X, 2) - sympy.diff(atom.u, Y, 2)
    length = _number(atom.length)
    laplacian = (
        atom.symbolic[3] if isinstance(atom, Polar) else sympy.diff(atom.v, T, 2) + sympy.diff(atom.v, D, 2)
    )
    return _value(atom) - laplacian.xreplace(_local(atom)) / length


def _flux(atom: Closed, *normal: float) -> sympy.Expr:
    """grad u . n, from the derivatives in the atom's own coordinates."""
    n = [_number(each) for each in normal]
    if isinstance(atom, Smooth):
        return sympy.diff(atom.u, X) * n[0] + sympy.diff(atom.u, Y) * n[1]
    if isinstance(atom, Tensor):
        slope = [sympy.diff(atom.v, z) for z in (T, D)]
    else:
        _, radial, angular, _ = atom.symbolic
        cos, sin = sympy.cos(THETA), sympy.sin(THETA)
        slope = [radial * cos - angular * sin, radial * sin + angular * cos]
    into_xy = [sum(s * _number(row[i]) for s, row in zip(slope, atom.frame, strict=True)) for i in range(2)]
    return sympy.Add(*(part * each for part, each in zip(into_xy, n, strict=True))).xreplace(_local(atom))
