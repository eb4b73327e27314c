"""Problems by their names: cases of the catalogue, and what YAML files declare."""

from __future__ import annotations

import os
from collections.abc import Sequence

from unilateral.geometry.polygon import Polygon
from unilateral.problems import arguments, problem_file
from unilateral.problems import case as cases
from unilateral.problems.case_certificate import certify_case, set_free_sides
from unilateral.problems.problem import Problem
from unilateral.system.files import check_path


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
    case_name = str(check_path(name, "natural"))
    if polygon is None:
        polygons = cases.read_case_declaration(case_name)[0]["polygons"]
        polygon = "square" if polygons == "any" else polygons[0]
    polygon_or_name = polygon if isinstance(polygon, Polygon) else str(check_path(polygon, "square"))
    domain = (
        problem_file.load_polygon(polygon_or_name) if isinstance(polygon_or_name, str) else polygon_or_name
    )
    solution = cases.load_solution(case_name, domain, arguments.as_side_number(side, domain, "side"))
    certify_case(solution)
    free = arguments.as_side_numbers(free_sides, domain, "free sides")
    return set_free_sides(solution.problem, free) if free else solution.problem


def load(path: str | os.PathLike[str]) -> Problem:
    """The problem, or the case, that a YAML file declares.

    Raises InputError with the file and the field.

    >>> import pathlib, tempfile
    >>> import unilateral as ul
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = pathlib.Path(folder, "own.yaml")
    ...     _ = file.write_text("{polygon: [[0, 0], [1, 0], [0, 1]], f: x - 1, g: 0}")
    ...     ul.load(file)
    Problem 'own'; polygon = 3 sides, area 0.5, f = x - 1, g = 0
    """
    name = str(check_path(path, "problem.yaml"))
    return problem_file.load_if_problem(name) or case(name)


def find_problem(problem_or_name: object) -> Problem | None:
    """The problem that is given, or that of a name; None for what is neither."""
    if isinstance(problem_or_name, str | os.PathLike):
        return load(problem_or_name)
    return problem_or_name if isinstance(problem_or_name, Problem) else None
