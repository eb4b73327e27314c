"""The study's configuration: read from its files, checked against its schema and for names that do not fit.

Messages name the file and the field; only the first fault is told.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any

from study import config_schema, figure_entries, registry
from unilateral.errors import InputError, shown
from unilateral.formulas.formula import real
from unilateral.geometry import polygon
from unilateral.problems.case import load
from unilateral.system import declarations

Fields = dict[str, Any]
Place = tuple[str | int, ...]


def read(files: Iterable[str]) -> tuple[Fields, dict[str, str]]:
    """All files' fields, and the file of each.

    Raises InputError for a file without fields, and for a field that an earlier file has, too.
    """
    study: Fields = {}
    sources: dict[str, str] = {}
    for file in files:
        given = declarations.read(Path(file), file, floats=True)
        if not isinstance(given, dict):
            raise InputError(f"{file} has no fields; it has to hold a mapping")
        for name in given:
            if name in study:
                raise InputError(f"{file}, field {name}: {sources[name]} has it, too; leave one of them out")
        study |= given
        sources |= dict.fromkeys(given, file)
    return study, sources


def check(study: Fields, sources: Mapping[str, str], rules: str) -> None:
    """Check the configuration, and fill in the defaults of the schema in the file `rules`.

    Raises InputError for what the schema does not allow, for names that stand for nothing, and for a case
    that cannot be put on its polygon or that has no expected rates.
    """
    # Cases first: other places may have only names that a scene has, and its misspelt ones would be offered.
    checks = (_beside_their_polygon, _unknown, _misfits, figure_entries.faults, _unfit_surveys, _unjudged)
    for place, said in itertools.chain(
        config_schema.faults(study, rules), *(faults(study) for faults in checks)
    ):
        raise InputError(f"{_where(place, sources)}: {said}")


def _where(place: Place, sources: Mapping[str, str]) -> str:
    if not place:
        return ", ".join(dict.fromkeys(sources.values()))
    name, *inside = place
    path = "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in inside)
    return f"{sources.get(str(name), 'the configuration')}, field {name}{path}"


def _unknown(study: Fields) -> Iterator[tuple[Place, str]]:
    """Faults: names that are not among those that the study has in another place."""
    scenes, base, vary = study["scenes"], study["cost"]["base"], study["cost"]["vary"]
    names: list[tuple[Place, str, Iterable[str]]] = [
        (("totals", "scenes", scene, i), case, scenes[scene]["cases"])
        for scene, cases in study["totals"]["scenes"].items()
        for i, case in enumerate(cases)
    ]
    for scene in (base["scene"], *vary.get("scene", [])):
        names.append((("cost", "base", "case"), base["case"], scenes[scene]["cases"]))
    for i, case in enumerate(vary.get("case", [])):
        names.append((("cost", "vary", "case", i), case, scenes[base["scene"]]["cases"]))
    for i, fields in enumerate(study["cost"]["cross"]):
        names += [(("cost", "cross", i, k), field, vary) for k, field in enumerate(fields)]
    for name, axis in study["extremes"]["axes"].items():
        names.append((("extremes", "axes", name, "kind"), axis["kind"], registry.axes()))
    for place, name, known in names:
        if name not in known:
            yield place, f"it is {shown(repr(name))}; it has to be one of {', '.join(known)}"


def _misfits(study: Fields) -> Iterator[tuple[Place, str]]:
    """Faults: numbers that do not fit together."""
    fewest = min(study["scenes"][name]["mesh"]["levels"] for name in study["totals"]["scenes"])
    if study["totals"]["levels"] > fewest:
        yield ("totals", "levels"), f"it has to be at most {fewest}, the levels of its scenes"
    ratios = study["rates"]["ratios"]
    if real(study["rates"]["judged_ratio"], "") not in [real(ratio, "") for ratio in ratios]:
        yield ("rates", "judged_ratio"), f"it has to be one of ratios, {', '.join(map(str, ratios))}"


def _beside_their_polygon(given: Any, place: Place = ()) -> Iterator[tuple[Place, str]]:
    """Faults: cases that are not declared, or not for the polygon and the side beside which they stand."""
    if isinstance(given, dict) and "polygon" in given:
        named = [((*place, "cases", i), name) for i, name in enumerate(given.get("cases", []))]
        named += [((*place, "case"), given["case"])] if "case" in given else []
        for at, name in named:
            if fault := _case_fault(name, given["polygon"], given.get("side", 0)):
                yield at, fault
    parts = given.items() if isinstance(given, dict) else enumerate(given) if isinstance(given, list) else ()
    for name, part in parts:
        yield from _beside_their_polygon(part, (*place, name))


def _unfit_surveys(study: Fields) -> Iterator[tuple[Place, str]]:
    """Faults: polygons that are none, numbers of cells that are not one for each side, and missing finds."""
    for name, survey in study["surveys"].items():
        place, finds = ("surveys", name), study["finds"].get(name, [])
        if survey["kind"] == "worst" and not finds:
            yield ("finds",), f"it has no pairs for the survey '{name}', whose kind is worst"
        if survey["kind"] != "worst" and finds:
            yield ("finds", name), f"only surveys of kind worst have pairs here; this one is {survey['kind']}"
        for i, find in enumerate(finds):
            if fault := _polygon_fault(find["polygon"]):
                yield ("finds", name, i, "polygon"), fault
        if "polygon" not in survey:
            continue
        given = survey["polygon"]
        if fault := _polygon_fault(given, name):
            yield (*place, "polygon"), fault
            continue
        sides = polygon.named(given).n_sides if isinstance(given, str) else len(given)
        for i, cells in enumerate(survey.get("partitions", [])):
            if len(cells.get("counts", range(sides))) != sides:
                yield (
                    (*place, "partitions", i, "counts"),
                    f"it has to have {sides} numbers, one for each side",
                )


def _polygon_fault(given: Any, name: str = "polygon") -> str:
    """Why these vertices are no polygon; empty if they are one, or a name."""
    try:
        if not isinstance(given, str):
            polygon.Polygon(given, name)
    except InputError as error:
        return str(error)
    return ""


@cache
def _case_fault(name: str, domain: str, side: int) -> str:
    """Why the case cannot be put on that side of that polygon; empty if it can."""
    try:
        load(name, polygon.named(domain), side)
    except InputError as error:
        return str(error)
    return ""


def _unjudged(study: Fields) -> Iterator[tuple[Place, str]]:
    """Faults: cases that no expected rates are given for, though a scene has them."""
    for name, scene in study["scenes"].items():
        for wanted in scene["cases"]:
            if wanted not in study["rates"]["cases"]:
                yield ("rates", "cases"), f"there is no '{wanted}'; add it, for scene '{name}' has that case"
