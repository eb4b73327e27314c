"""A case as Python expressions in x and y: u, f, and on each side g and lambda = du/dn.

Beside numpy's names the expressions use `pos` and `angle`, which `DEFINITIONS` define.
"""

from __future__ import annotations

from typing import Any

import sympy

from unilateral.problems.atoms import D, Smooth, T, Tensor, X, Y
from unilateral.problems.case import Case
from unilateral.problems.polar import THETA, Polar, R

DEFINITIONS = (
    "from numpy import *\n"
    "def pos(a, k):  # the power a_+^k of the positive part\n"
    "    return where(a > 0, where(a > 0, a, 1.0) ** k, 0.0)\n"
    "def angle(b, a):  # of (a, b), in [0, 2 pi); b is 0 up to rounding on a side\n"
    "    return arctan2(where(abs(b) < 1e-12, abs(b), b), a) % (2 * pi)\n"
)
Closed = Smooth | Tensor | Polar
ANGLE = sympy.Function("angle", real=True)


def formulas(case: Case) -> dict[str, Any]:
    """`u` and `f`; `g` and `lambda` per side; each None where the case has no closed formula."""
    sides = range(case.polygon.n_sides)
    atoms = [atom for atom in case.atoms if isinstance(atom, Closed)]
    if len(atoms) < len(case.atoms):
        return {"u": None, "f": None, "g": [None for _ in sides], "lambda": [None for _ in sides]}
    u, f = (sympy.Add(*map(of, atoms)) for of in (_value, _source))
    flux = [sympy.Add(*(_flux(atom, *normal) for atom in atoms)) for normal in case.polygon.normals]
    g = [u - case.gaps[i].xreplace({T: _along(case, i)}) for i in sides]
    return {"u": _text(u), "f": _text(f), "g": [*map(_text, g)], "lambda": [*map(_text, flux)]}


def _text(expression: sympy.Expr) -> str:
    """As Python has it; numbers with all their digits."""
    return sympy.sstr(expression, full_prec=True)


def _along(case: Case, side: int) -> sympy.Expr:
    """t, the arc length from the side's start in side lengths."""
    (a, b), (p, q) = case.polygon.vertices[side], case.polygon.tangents[side]
    s = (X - _number(a)) * _number(p) + (Y - _number(b)) * _number(q)
    return s / _number(case.polygon.lengths[side])


def _number(value: float) -> sympy.Expr:
    """Exact: a whole number as such."""
    return sympy.Integer(int(value)) if float(value).is_integer() else sympy.Float(float(value), 17)


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
