"""The study's configuration: read from its files, checked by a schema, and for what does not fit together.

The schema of an experiment's own fields is the file `schema.yaml` in its folder. Messages name the file and
the field; only the first fault is told.
"""

from __future__ import annotations

import itertools
import operator
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any

from unilateral.errors import InputError, quote_input
from unilateral.formulas.formula import parse_real
from unilateral.geometry.polygon import Polygon, find_polygon
from unilateral.problems.case import load_solution
from unilateral.system import declarations
from unilateral.system.declarations import MAX_DEPTH, MAX_INTEGER_DIGITS

Fields = dict[str, Any]
Place = tuple[str | int, ...]
EXPERIMENTS_FOLDER = Path(__file__).parent / "experiments"
COMMAND_LINE = "the option --config"
"""The source of fields that no file has."""
RESERVED_FOLDERS = ("benchmarks", "logs", "paper", "report")
"""Folders of results that belong to no scene, survey or experiment."""
FIELD_LIMITS = {
    "grading": (operator.ge, 1, "at least 1"),
    "spread": (operator.ge, 1, "at least 1"),
    "shift": (operator.lt, 1, "below 1"),
    "kappas": (operator.le, 1, "at most 1"),
    "deltas": (operator.le, 0.5, "at most 1/2"),
    "stabilisation": (operator.lt, 0.5, "below 1/2"),
}
"""Limits of numbers and of those in lists, by the names of fields. JSON Schema does not know fractions."""
FIELD_ORDERS = {
    "H": (operator.gt, "smaller"),
    "stops": (operator.gt, "smaller"),
    "kappas": (operator.gt, "smaller"),
    "points": (operator.lt, "larger"),
    "nodes": (operator.lt, "larger"),
    "c_over_k": (operator.lt, "larger"),
}
"""How numbers of a list are ordered, by the names of fields."""


def read_configuration(files: Iterable[str]) -> tuple[Fields, dict[str, str]]:
    """All files' fields, and the file of each.

    Raises InputError for a file without fields, and for a field that an earlier file has, too.
    """
    study: Fields = {}
    sources: dict[str, str] = {}
    for file in files:
        fields = declarations.read_declaration(Path(file), file, floats=True)
        if not isinstance(fields, dict):
            raise InputError(f"{file} has no fields; it has to hold a mapping")
        for name in fields:
            if name in study:
                raise InputError(f"{file}, field {name}: {sources[name]} has it, too; leave one of them out")
        study |= fields
        sources |= dict.fromkeys(fields, file)
    return study, sources


def check(study: Fields, sources: Mapping[str, str], schema: str) -> None:
    """Check the configuration by the schema in a file, and those of the experiments.

    Raises InputError for what a schema does not allow, for names that stand for nothing, for numbers that do
    not fit together, and for a case that cannot be put on its polygon or that has no expected rates.
    """
    _raise_first_fault(_find_option_faults(study), sources)
    rules = _read_schema(schema)
    for source in dict.fromkeys([*sources.values(), COMMAND_LINE]):
        fields = {name: value for name, value in study.items() if sources.get(name, COMMAND_LINE) == source}
        declarations.validate(fields, rules, source)
    for name in rules["properties"]:
        if name not in study:
            raise InputError(f"{', '.join(dict.fromkeys(sources.values()))}: the field '{name}' is missing")
    # Cases first: other places may have only names that a scene has, and its misspelt ones would be offered.
    for faults in (
        _find_polygon_faults,
        _find_name_faults,
        _find_number_faults,
        _find_relation_faults,
        _find_folder_faults,
        _find_survey_faults,
        _find_missing_rates,
    ):
        _raise_first_fault(faults(study), sources)


@cache
def _read_schema(schema: str) -> Fields:
    """The schema in a file, with the fields of all experiments."""
    rules: Fields = declarations.read_stored_yaml(Path(schema))
    for file in sorted(EXPERIMENTS_FOLDER.glob("*/schema.yaml")):
        rules["properties"] |= declarations.read_stored_yaml(file)
    return rules


def _raise_first_fault(faults: Iterator[tuple[Place, str]], sources: Mapping[str, str]) -> None:
    """Raise InputError for the first of these faults: the place of each, and what would be right."""
    for (name, *inside), fault in faults:
        path = "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in inside)
        raise InputError(
            f"{sources.get(str(name), COMMAND_LINE)}, field {quote_input(f'{name}{path}')}: {fault}"
        )


def _walk_values(study: Fields) -> Iterator[tuple[Place, Any]]:
    """All values of nested fields and lists, each with its place."""
    waiting: list[tuple[Place, Any]] = [((), study)]
    while waiting:
        place, value = waiting.pop()
        yield place, value
        if isinstance(value, dict) and len(place) <= MAX_DEPTH:
            waiting += [((*place, name), item) for name, item in value.items()]
        elif isinstance(value, list) and len(place) <= MAX_DEPTH:
            waiting += [((*place, i), item) for i, item in enumerate(value)]


def _find_option_faults(study: Fields) -> Iterator[tuple[Place, str]]:
    """Faults: what no file may hold, but --config gives."""
    for place, value in _walk_values(study):
        if isinstance(value, int) and abs(value) >= 10**MAX_INTEGER_DIGITS:
            yield place, f"it has more than {MAX_INTEGER_DIGITS} digits"
        elif isinstance(value, dict | list) and len(place) >= MAX_DEPTH:
            yield place, f"it is in more than {MAX_DEPTH} lists or fields"
        elif isinstance(value, dict):
            for name in value:
                if not isinstance(name, str):
                    yield (*place, str(name)), "the name of a field has to be a text"


def _find_polygon_faults(study: Fields) -> Iterator[tuple[Place, str]]:
    """Faults: polygons that are none, and cases that are none or not for the polygon and side beside them."""
    for place, fields in _walk_values(study):
        if not isinstance(fields, dict) or "polygon" not in fields:
            continue
        polygon = fields["polygon"]
        try:
            find_polygon(polygon) if isinstance(polygon, str) else Polygon(polygon, str(place[1]))
        except InputError as error:
            yield (*place, "polygon"), str(error)
        for i, name in enumerate(fields.get("cases", [])):
            if fault := _case_fault(name, polygon, fields.get("side", 0)):
                yield (*place, "cases", i), fault


@cache
def _case_fault(name: str, polygon: str, side: int) -> str:
    """Why the case cannot be put on that side of that polygon; empty if it can."""
    try:
        load_solution(name, find_polygon(polygon), side)
    except InputError as error:
        return str(error)
    return ""


def _find_name_faults(study: Fields) -> Iterator[tuple[Place, str]]:
    """Faults: names that are not among those that the study has in another place."""
    for place, name, valid_names in _list_references(study):
        if name not in valid_names:
            yield place, f"{quote_input(repr(name))} is not one of {', '.join(valid_names)}"


def _list_references(study: Fields) -> Iterator[tuple[Place, str, Iterable[str]]]:
    """Names, each with its place and those that it may be; of scenes before those of their cases."""
    scenes = study["scenes"]
    cost = study["cost"]
    figures = study["figures"]
    for scene, cases in study["totals"]["scenes"].items():
        yield ("totals", "scenes"), scene, scenes
        for i, case in enumerate(cases):
            yield ("totals", "scenes", scene, i), case, scenes[scene]["cases"]
    yield from _list_unproved_references(study)
    for field in ("floors", "u_in_l2"):
        for i, scene in enumerate(study[field]):
            yield (field, i), scene, scenes
    for scene in cost["h"]:
        yield ("cost", "h"), scene, scenes
    base = cost["base"]
    yield ("cost", "base", "scene"), base["scene"], cost["h"]
    yield ("cost", "base", "case"), base["case"], scenes[base["scene"]]["cases"]
    for axis, fields in cost["axes"].items():
        for i, scene in enumerate(fields.get("scene", [])):
            yield ("cost", "axes", axis, "scene", i), scene, cost["h"]
            yield ("cost", "base", "case"), base["case"], scenes[scene]["cases"]
        for i, case in enumerate(fields.get("case", [])):
            yield ("cost", "axes", axis, "case", i), case, scenes[base["scene"]]["cases"]
    for i, scene in enumerate(figures["rates"]["scenes"]):
        yield ("figures", "rates", "scenes", i), scene, scenes
    square = scenes["square"]["cases"]
    irregular = scenes["irregular"]["cases"]
    for i, case in enumerate(figures["grid_square"]["cases"]):
        yield ("figures", "grid_square", "cases", i), case, square
    yield ("figures", "consistency", "case"), figures["consistency"]["case"], [*square, *irregular]
    for i, case in enumerate(figures["consistency"]["cases"]):
        yield ("figures", "consistency", "cases", i), case, [*square, *irregular]


def _list_unproved_references(study: Fields) -> Iterator[tuple[Place, str, Iterable[str]]]:
    """Scenes on which no theorem proves a rate, each with its place and those that it may be."""
    for case, norms in study["rates"]["cases"].items():
        for norm, expected in norms.items():
            for i, scene in enumerate(expected.get("unproved", [])):
                yield ("rates", "cases", case, norm, "unproved", i), scene, study["scenes"]


def _find_number_faults(study: Fields) -> Iterator[tuple[Place, str]]:
    """Faults: numbers beyond their limits or not in their order."""
    for place, value in _walk_values(study):
        field = str(place[-1]) if place else ""
        if isinstance(value, dict) or field not in FIELD_LIMITS | FIELD_ORDERS:
            continue
        numbers = value if isinstance(value, list) else [value]
        sizes = [_field_number(number) for number in numbers]
        if field in FIELD_LIMITS:
            keeps, limit, requirement = FIELD_LIMITS[field]
            for number, size in zip(numbers, sizes, strict=True):
                if not keeps(size, limit):
                    yield place, f"it is {quote_input(number)}; it has to be {requirement}"
        if field in FIELD_ORDERS:
            precedes, requirement = FIELD_ORDERS[field]
            if not all(precedes(a, b) for a, b in itertools.pairwise(sizes)):
                yield place, f"each number has to be {requirement} than the one before it"


def _find_relation_faults(study: Fields) -> Iterator[tuple[Place, str]]:
    """Faults: numbers that do not fit together."""
    fewest = min(study["scenes"][name]["mesh"]["levels"] for name in study["totals"]["scenes"])
    if study["totals"]["levels"] > fewest:
        yield ("totals", "levels"), f"it has to be at most {fewest}, the levels of its scenes"
    ratios = study["rates"]["ratios"]
    if _field_number(study["rates"]["judged_ratio"]) not in map(_field_number, ratios):
        yield ("rates", "judged_ratio"), f"it has to be one of ratios, {', '.join(map(str, ratios))}"


@cache
def _field_number(number: str | float) -> float:
    """The number, which may be written as a fraction."""
    return parse_real(number, "") if isinstance(number, str) else number


def _find_folder_faults(study: Fields) -> Iterator[tuple[Place, str]]:
    """Faults: scenes and surveys whose folders of results would be those of others."""
    for kind, taken_names in (("scenes", study["surveys"]), ("surveys", study["scenes"])):
        for name in study[kind]:
            if name in (*RESERVED_FOLDERS, *study, *taken_names):
                yield (kind, name), "another folder of results has that name; choose another one"


def _find_survey_faults(study: Fields) -> Iterator[tuple[Place, str]]:
    """Faults: numbers of cells that are not one for each side, and finds that are missing or in vain."""
    for name, survey in study["surveys"].items():
        finds = study["finds"].get(name, [])
        if survey["kind"] == "worst" and not finds:
            yield ("finds",), f"it has no pairs for the survey '{name}', whose kind is worst"
        if survey["kind"] != "worst" and finds:
            yield ("finds", name), f"only surveys of kind worst have pairs here; this one is {survey['kind']}"
        for i, cells in enumerate(survey.get("partitions", [])):
            polygon = survey["polygon"]
            sides = find_polygon(polygon).n_sides if isinstance(polygon, str) else len(polygon)
            if len(cells.get("counts", range(sides))) != sides:
                place = ("surveys", name, "partitions", i, "counts")
                yield place, f"it has to have {sides} numbers, one for each side"


def _find_missing_rates(study: Fields) -> Iterator[tuple[Place, str]]:
    """Faults: cases that no expected rates are given for, though a scene has them."""
    for name, scene in study["scenes"].items():
        for case in scene["cases"]:
            if case not in study["rates"]["cases"]:
                yield ("rates", "cases"), f"there is no '{case}'; add it, for scene '{name}' has that case"
