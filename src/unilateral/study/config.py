"""The study's configuration: read from its files, checked against its schema and for names that do not fit.

Messages name the file and the field; only the first fault is told.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any

from unilateral.errors import InputError
from unilateral.formulas.formula import real
from unilateral.geometry import polygon
from unilateral.geometry.polygon import Polygon
from unilateral.problems import case
from unilateral.study import figure_entries, schema
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
    checks = (_unknown, _disordered, figure_entries.faults, _beside_their_polygon, _unjudged)
    for place, said in itertools.chain(schema.faults(study, rules), *(faults(study) for faults in checks)):
        raise InputError(f"{_where(place, sources)}: {said}")


def _where(place: Place, sources: Mapping[str, str]) -> str:
    if not place:
        return ", ".join(dict.fromkeys(sources.values()))
    name, *inside = place
    path = "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in inside)
    return f"{sources.get(str(name), 'the configuration')}, field {name}{path}"


def _unknown(study: Fields) -> Iterator[tuple[Place, str]]:
    """Faults: names that are not among those allowed in their place."""
    for place, name, known in _names(study):
        if name not in known:
            yield place, f"it is '{name}'; it has to be one of {', '.join(known)}"


def _names(study: Fields) -> Iterator[tuple[Place, str, Iterable[str]]]:
    """Where a name stands, the name, and the names that are allowed there."""
    scenes, cost = study["scenes"], study["cost"]

    def listed(names: Iterable[str], known: Iterable[str], *place: str | int) -> Iterator[Any]:
        yield from (((*place, i), name, known) for i, name in enumerate(names))

    for name, cases in study["totals"]["scenes"].items():
        yield ("totals", "scenes"), name, scenes
        yield from listed(cases, scenes[name]["cases"], "totals", "scenes", name)
    yield from listed(study["floors"], scenes, "floors")
    base, vary = cost["base"], cost["vary"]
    yield ("cost", "base", "scene"), base["scene"], scenes
    yield from listed(vary.get("scene", []), scenes, "cost", "vary", "scene")
    yield from listed([job["scene"] for job in cost["jobs"]], scenes, "cost", "jobs")
    for scene in (base["scene"], *vary.get("scene", [])):
        yield ("cost", "base", "case"), base["case"], scenes[scene]["cases"]
    yield from listed(vary.get("case", []), scenes[base["scene"]]["cases"], "cost", "vary", "case")
    for i, names in enumerate(cost["cross"]):
        yield from listed(names, vary, "cost", "cross", i)


def _disordered(study: Fields) -> Iterator[tuple[Place, str]]:
    """Faults: numbers that do not fit together."""
    scenes = study["scenes"]
    falling: list[tuple[Place, list[Any]]] = [
        *((("scenes", name, "H"), scene["H"]) for name, scene in scenes.items()),
        (("sharpness", "H"), study["sharpness"]["H"]),
        (("sharpness", "fixed", "H"), study["sharpness"]["fixed"]["H"]),
        (("cells", "H"), study["cells"]["H"]),
        (("cost", "stops"), study["cost"]["stops"]),
    ]
    for place, given in falling:
        sizes = [real(size, "") for size in given]
        if any(a <= b for a, b in itertools.pairwise(sizes)):
            yield place, "each number has to be smaller than the one before it"
    for i, name in itertools.product(range(len(study["finds"])), ("points", "nodes")):
        if any(a >= b for a, b in itertools.pairwise(study["finds"][i][name])):
            yield ("finds", i, name), "each number has to be larger than the one before it"
    fewest = min(scenes[name]["mesh"]["levels"] for name in study["totals"]["scenes"])
    if study["totals"]["levels"] > fewest:
        yield ("totals", "levels"), f"it has to be at most {fewest}, the levels of its scenes"
    ratios = study["rates"]["ratios"]
    if real(study["rates"]["judged_ratio"], "") not in [real(ratio, "") for ratio in ratios]:
        yield ("rates", "judged_ratio"), f"it has to be one of ratios, {', '.join(map(str, ratios))}"


def _beside_their_polygon(study: Fields) -> Iterator[tuple[Place, str]]:
    """Faults: cases not declared, or not for their polygon or side; surveys that do not fit their polygon."""
    chosen: list[tuple[Place, Fields, list[str]]] = [
        *((("scenes", name, "cases"), scene, scene["cases"]) for name, scene in study["scenes"].items()),
        *(((name, "cases"), study[name], study[name]["cases"]) for name in ("algorithm", "cells")),
        *(
            (("adaptive", "scenes", i, "cases"), scene, scene["cases"])
            for i, scene in enumerate(study["adaptive"]["scenes"])
        ),
        *(
            (("figures", name, "parameters"), entry["parameters"], [entry["parameters"]["case"]])
            for name, entry in study["figures"].items()
            if {"polygon", "case"} <= set(entry["parameters"])
        ),
    ]
    for place, scene, names in chosen:
        for i, name in enumerate(names):
            fault = _case_fault(name, scene["polygon"], scene.get("side", 0))
            if fault:
                yield (*place, i) if place[-1] == "cases" else (*place, "case"), fault
    for name, survey in study["surveys"].items():
        for place, said in _survey_faults(survey, name):
            yield ("surveys", name, *place), said


def _survey_faults(survey: Fields, name: str) -> Iterator[tuple[Place, str]]:
    """Faults for which `families` would refuse a survey."""
    try:
        sides = _domain(survey["polygon"], name).n_sides
    except InputError as error:
        yield ("polygon",), str(error)
        return
    specs: list[tuple[Place, Fields]] = [(("mesh",), survey.get("mesh", {}))]
    specs += [(("partitions", i), cells) for i, cells in enumerate(survey.get("partitions", []))]
    for place, spec in specs:
        if len(spec.get("counts", range(sides))) != sides:
            yield (*place, "counts"), f"it has to have {sides} numbers, one for each side"
        if real(spec.get("shift", 0), "") >= 1:
            yield (*place, "shift"), f"it is {spec['shift']}; it has to be below 1"
        for field in ("grading", "spread"):
            if real(spec.get(field, 1), "") < 1:
                yield (*place, field), f"it is {spec[field]}; it has to be at least 1"

    for i, delta in enumerate(survey.get("deltas", [])):
        if real(delta, "") > 0.5:
            yield ("deltas", i), f"it is {delta}; it has to be at most 1/2"


def _domain(given: Any, name: str) -> Polygon:
    return polygon.named(given) if isinstance(given, str) else Polygon(given, name)


@cache
def _case_fault(name: str, domain: str, side: int) -> str:
    """Why the case cannot be put on that side of that polygon; empty if it can."""
    try:
        case.load(name, polygon.named(domain), side)
    except InputError as error:
        return str(error)
    return ""


def _unjudged(study: Fields) -> Iterator[tuple[Place, str]]:
    """Faults: cases that no expected rates are given for, though a scene has them."""
    for name, scene in study["scenes"].items():
        for wanted in scene["cases"]:
            if wanted not in study["rates"]["cases"]:
                yield ("rates", "cases"), f"there is no '{wanted}'; add it, for scene '{name}' has that case"
