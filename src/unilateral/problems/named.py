"""Problems by their names: cases of the catalogue, and what YAML files declare."""

from __future__ import annotations

import os
from collections.abc import Sequence

from unilateral.geometry.polygon import Polygon
from unilateral.problems import arguments, problem_file
from unilateral.problems import case as cases
from unilateral.problems.case_certificate import certify, with_free_sides
from unilateral.problems.problem import Problem
from unilateral.system.files import path_of


def case(
    name: str | os.PathLike[str],
    polygon: str | Polygon | None = None,
    side: int = 0,
    free_sides: Sequence[int] | None = (),
) -> Problem:
    """A case of the catalogue by its name, or of a YAML file: a problem whose solution is known.

    It is put on that side of the polygon, which is by default the first of those that it is for. A polygon is
    given by its name, or by a YAML file that has it in the field `polygon`. On `free_sides`, which must carry
    no contact, there are no multipliers. Raises InputError, among others for a case that is not certified.

    >>> import unilateral as ul
    >>> ul.case("natural").polygon.name
    'square'
    """
    given = str(path_of(name, "natural"))
    if polygon is None:
        polygons = cases.declared(given)[0]["polygons"]
        polygon = "square" if polygons == "any" else polygons[0]
    on = polygon if isinstance(polygon, Polygon) else str(path_of(polygon, "square"))
    domain = problem_file.polygon_of(on) if isinstance(on, str) else on
    found = cases.load(given, domain, arguments.side(side, domain.n_sides, "side"))
    certify(found)
    free = arguments.sides(free_sides, domain.n_sides, "free sides")
    return with_free_sides(found.problem, free) if free else found.problem


def load(path: str | os.PathLike[str]) -> Problem:
    """What a YAML file declares: a problem, or a case. Raises InputError with the file and the field.

    >>> import pathlib, tempfile
    >>> import unilateral as ul
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = pathlib.Path(folder, "own.yaml")
    ...     _ = file.write_text("{polygon: [[0, 0], [1, 0], [0, 1]], f: x - 1, g: 0}")
    ...     ul.load(file)
    Problem 'own'; polygon = 3 sides, area 0.5, f = x - 1, g = 0
    """
    name = str(path_of(path, "problem.yaml"))
    return problem_file.problem_in(name) or case(name)


def find_problem(given: object) -> Problem | None:
    """The problem that is given, or that of a name; None for what is neither."""
    if isinstance(given, str | os.PathLike):
        return load(given)
    return given if isinstance(given, Problem) else None
