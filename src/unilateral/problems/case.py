"""Cases: manufactured solutions, declared in YAML files and derived here.

A case declares u as a sum of atoms and the gap u - g on every side; f = -Delta u + c u, lambda = du/dn and g
= u - gap follow. On clamped sides it declares u once more, as a formula. A case is a `Problem` with that
`ExactSolution`. `case_certificate.certify_case` checks what the paper asks of it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cached_property, reduce
from importlib import resources
from importlib.resources.abc import Traversable
from math import inf, lcm
from pathlib import Path
from typing import Any

import numpy as np

from unilateral.arrays import Array, Index, Mask
from unilateral.errors import InputError, quote_input, suggest_name
from unilateral.formulas.expression import ZERO, Expression, rational_expression
from unilateral.formulas.formula import CompiledFormulas, compile_numpy, find_kinks
from unilateral.formulas.taylor import TaylorModel
from unilateral.geometry.curves import Kink, SingularPoint
from unilateral.geometry.polygon import Polygon
from unilateral.problems import arguments
from unilateral.problems.atoms import SidePoints, SmoothAtom
from unilateral.problems.cantor_atom import CantorAtom
from unilateral.problems.case_builder import CaseAtom, CaseBuilder, read_constants
from unilateral.problems.catalogue import case_names, catalogue_folder
from unilateral.problems.problem import Problem
from unilateral.problems.side_models import model_side_data, side_coordinates
from unilateral.system import declarations


@dataclass(frozen=True, eq=False)
class ExactSolution:
    """u of a manufactured problem on a polygon, with lambda, f and g, which follow from u and the gaps.

    `gaps` holds u - g as one expression in t (the arc length in side lengths) per side. The case was put on
    `side`. `clamped_values` has u on the clamped sides, as it is declared there. Lengths along a side are
    measured from its start.
    """

    name: str
    declaration: Mapping[str, Any]
    polygon: Polygon
    atoms: tuple[CaseAtom, ...]
    gaps: tuple[Expression, ...]
    side: int = 0
    clamped_values: Mapping[int, Expression] = field(default_factory=dict)

    @cached_property
    def problem(self) -> Problem:
        """The problem that has this solution, without free sides."""
        return Problem(
            name=self.name,
            polygon=self.polygon,
            f=ZERO,
            g=tuple(self.clamped_values.get(side, ZERO) for side in range(self.polygon.n_sides)),
            free_sides=(),
            c=rational_expression(self.declaration.get("c", 1)),
            title=self.title,
            clamped_sides=self.clamped_sides,
            exact=self,
        )

    @cached_property
    def c(self) -> float:
        """The coefficient c of u in (1.1), 1 or 0."""
        return float(self.declaration.get("c", 1))

    @property
    def clamped_sides(self) -> tuple[int, ...]:
        """The sides on which u is given in place of (1.2)."""
        return tuple(sorted(self.clamped_values))

    @property
    def title(self) -> str:
        """One line that says what the case is."""
        return str(self.declaration.get("title", ""))

    def __repr__(self) -> str:
        return f"Exact solution of case '{self.name}' on '{self.polygon.name}'"

    def value_and_gradient(self, points: Array, offset: Array | float = 0.0) -> tuple[Array, Array]:
        """u (k,) and grad u (k, 2) at the places points + offset (k, 2) of Omega.

        Near a singular point give that point and the offset from it, which the sum would round away.
        """
        value, gradient = _sum_over_atoms(atom.value_and_gradient(points, offset) for atom in self.atoms)
        return value, gradient

    def value_gradient_and_source(
        self, points: Array, offset: Array | float = 0.0
    ) -> tuple[Array, Array, Array]:
        """u, grad u and f = -Delta u + c u at points + offset, (1.1)."""
        value, gradient, f = _sum_over_atoms(
            atom.value_gradient_and_source(points, offset) for atom in self.atoms
        )
        # The atoms have -Delta u + u
        return value, gradient, f if self.c else f - value

    def source(self, points: Array, offset: Array | float = 0.0) -> Array:
        """f (k,) at the places points + offset (k, 2) of Omega."""
        return self.value_gradient_and_source(points, offset)[2]

    def vanishes_in_circles(self, centre: Array, radius: Array) -> Mask:
        """Whether u is known to be 0 in each circle, (k,)."""
        return np.logical_and.reduce([atom.vanishes_in_circles(centre, radius) for atom in self.atoms])

    def source_model(self, x: TaylorModel, y: TaylorModel) -> TaylorModel:
        """f on the boxes of x and y."""
        f = reduce(TaylorModel.__add__, (atom.source_model(x, y) for atom in self.atoms))
        return f if self.c else f + self._value_model(x, y).scale(-1.0)

    def _value_model(self, x: TaylorModel, y: TaylorModel) -> TaylorModel:
        return reduce(TaylorModel.__add__, (atom.value_model(x, y) for atom in self.atoms))

    def obstacle_model(self, side: Index, t: TaylorModel) -> TaylorModel:
        """g = u - gap on intervals of the sides (k,), t the arc length in side lengths."""
        u = self._value_model(*side_coordinates(self.polygon, side, t))
        return u + model_side_data([-gap for gap in self.gaps], side, {"t": t})

    def trace_flux_and_gap(
        self, side: Index, s: Array, near: tuple[Array, Array] | None = None
    ) -> tuple[Array, Array, Array]:
        """u, lambda = du/dn (Theorem 1.2) and the gap u - g, (k,) each, at the arc lengths s of the sides.

        On clamped sides lambda is 0: they have no multiplier. `near` has, for every place, a point t of its
        side, in side lengths, and the arc length from there.
        """
        # Near a singular point the anchor is that point, so that the distance from it is not rounded
        lengths = self.polygon.lengths[side]
        anchor, offset = near or (s / lengths, np.zeros(len(s)))
        u = np.zeros(len(s))
        flux = np.zeros(len(s))
        for i in np.unique(side):
            rows = np.flatnonzero(side == i)
            along = SidePoints((s / lengths)[rows], anchor[rows], (offset / lengths)[rows])
            u[rows], flux[rows] = self.trace_and_normal_flux(int(i), s[rows], along)
        return u, np.where(np.isin(side, self.clamped_sides), 0.0, flux), self.gap(side, s)

    def gap(self, side: Index, s: Array) -> Array:
        """The gap u - g (k,) at the arc lengths s of the sides."""
        t = s / self.polygon.lengths[side]
        gap = np.zeros(len(s))
        for i in np.unique(side):
            rows = side == i
            gap[rows] = self._gap_functions[i](t[rows])[0]
        return gap

    def trace_and_normal_flux(self, side: int, s: Array, along: SidePoints) -> tuple[Array, Array]:
        """u and du/dn (k,) at arc lengths s (k,) of a side."""
        points = self.polygon.at(np.full(len(s), side), s)
        u = np.zeros(len(s))
        flux = np.zeros(len(s))
        for atom in self.atoms:
            # By grad u . n where the side is no special one; else from the atom's own coordinates, exactly
            if isinstance(atom, SmoothAtom) or not atom.touches(side):
                value, gradient = atom.value_and_gradient(points)
                normal = gradient @ self.polygon.normals[side]
            else:
                value, normal = atom.trace_and_normal_flux(side, along)
            u = u + value
            flux = flux + normal
        return u, flux

    @cached_property
    def _gap_functions(self) -> list[CompiledFormulas]:
        return [compile_numpy([gap], "t") for gap in self.gaps]

    @cached_property
    def gap_kinks(self) -> list[list[tuple[float, Fraction]]]:
        """Per side, the places t at which the gap has a power of a positive part, each with the exponent."""
        return [find_kinks(gap, "t") for gap in self.gaps]

    @cached_property
    def gap_order(self) -> float:
        """u - g is in H^tau on every side for every tau below this: k + 1/2 for powers s_+^k.

        From that half of the dimension of the set of transitions is subtracted, see `cantor_atom`.
        """
        powers = [float(k) for side in self.gap_kinks for _, k in side]
        dimensions = [atom.cantor_set.dimension for atom in self.atoms if isinstance(atom, CantorAtom)]
        return min(powers, default=inf) + (1 - max(dimensions, default=0.0)) / 2

    def transitions(self) -> Array:
        """Arc lengths (k,) of the places inside sides where, by the declaration, contact can begin or end.

        These are the kinks of the gap: where u > g turns into u = g the gap is declared by a positive part.
        """
        places = [(side, t) for side, points in enumerate(self.gap_kinks) for t, _ in points if 0 < t < 1]
        side = np.array([side for side, _ in places], dtype=np.intp)
        t = np.array([t for _, t in places])
        return self.polygon.starts[side] + t * self.polygon.lengths[side]

    def kinks(self) -> list[Kink]:
        """The curves in Omega across which u is only finitely smooth."""
        return [kink for atom in self.atoms for kink in atom.kinks()]

    @property
    def flux_in_L2(self) -> bool:
        """Whether lambda is square integrable; errors of lambda in L2 are NaN if not."""
        return all(atom.regularity.flux_in_L2 for atom in self.atoms)

    def flux_singular_points(self) -> list[SingularPoint]:
        """The points of sides at which lambda, and u in Omega, behave like a fractional power."""
        points = [point for atom in self.atoms for point in atom.singular_points()]
        return [point for point in points if point.grading > 1 and 0 <= point.t <= 1]

    def singular_points(self) -> list[SingularPoint]:
        """The points of the sides at which u, lambda or the gap are not smooth, without repetition."""
        return self._singular_points

    @cached_property
    def _singular_points(self) -> list[SingularPoint]:
        all_points = [point for atom in self.atoms for point in atom.singular_points()]
        all_points += [point for kink in self.kinks() for point in kink.crossings(self.polygon)]
        for side, points in enumerate(self.gap_kinks):
            all_points += [SingularPoint(side, t, exponent.denominator) for t, exponent in points]
        # Points that agree up to rounding are one, graded by the least common multiple
        merged: dict[tuple[int, float], SingularPoint] = {}
        for point in all_points:
            t = round(point.t, 12)
            if 0 <= t <= 1:
                earlier = merged.get((point.side, t), point)
                place = t if t in (0, 1) else earlier.t
                merged[point.side, t] = SingularPoint(point.side, place, lcm(earlier.grading, point.grading))
        return [merged[key] for key in sorted(merged)]


def _sum_over_atoms(values: Iterable[tuple[Array, ...]]) -> list[Array]:
    """The sums of the atoms' values."""
    return [sum(later, start=first) for first, *later in zip(*values, strict=True)]


def load_solution(case: str | Path, polygon: Polygon, side: int = 0) -> ExactSolution:
    """The solution of the case of that name, or declared in that file, put on a side of a polygon.

    Raises InputError for an unknown name, a declaration against the schema, or a polygon it is not for.
    """
    return derive_solution(*read_case_declaration(case), polygon, side)


def derive_solution(
    declaration: Mapping[str, Any], name: str, polygon: Polygon, side: int = 0
) -> ExactSolution:
    """The solution that a case declares; raises InputError as `load_solution`."""
    where = f"case '{name}'"
    if declaration["polygons"] != "any" and polygon.name not in declaration["polygons"]:
        raise InputError(f"{where} is for {', '.join(declaration['polygons'])}, not for '{polygon.name}'")
    arguments.as_side_number(side, polygon, where)
    constants = read_constants(declaration, polygon, where)
    build = CaseBuilder(where, polygon, side, constants)
    atoms = tuple(build.build_atom(entry, f"{where}, u[{i}]") for i, entry in enumerate(declaration["u"]))
    values = build.read_clamped_values(declaration.get("clamped", []))
    # a clamped side has no obstacle, and so no gap
    gaps = tuple(ZERO if i in values else gap for i, gap in enumerate(build.build_gaps(declaration["gap"])))
    return ExactSolution(name, declaration, polygon, atoms, gaps, side, values)


def read_case_declaration(case: str | Path) -> tuple[dict[str, Any], str]:
    """The declaration of a case as the schema allows it, and the case's name."""
    name = str(case)
    file: Path | Traversable | None = None if name in case_names() else declarations.find_yaml_file(name)
    if file is None:
        file = catalogue_folder() / f"{name}.yaml"
        if name not in case_names():
            names = ", ".join(case_names())
            raise InputError(
                f"case '{quote_input(name)}' is unknown; known are {names}{suggest_name(name, case_names())}"
            )
    schema = resources.files("unilateral.problems") / "case.schema.yaml"
    declaration = declarations.validate(declarations.read_declaration(file, name), schema, name)
    return declaration, file.name.removesuffix(".yaml").removesuffix(".yml")
