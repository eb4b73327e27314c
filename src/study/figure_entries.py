"""The figures that the configuration asks for: the module of each, what it reads, and its parameters.

An entry with `scenes` asks for a figure of each scene; `{scene}` in the entry stands for its name. A path
with `{surveys}` stands for the files of all surveys.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import reduce
from importlib import import_module
from itertools import chain
from typing import Any, NamedTuple

from study import registry
from study.tables import save_csv
from unilateral import errors

Fields = Mapping[str, Any]
Place = tuple[str | int, ...]


class Drawing(NamedTuple):
    """A figure: `reads` are files of results, and `arguments` the other arguments of its module's `table`.

    `shows` says what it shows, and `cases` are the cases that it names.
    """

    module: str
    shows: str
    reads: dict[str, str | list[str]]
    arguments: dict[str, Any]
    cases: list[str]


def make_figure(module: str, arguments: Mapping[str, Any], csv: str, svg: str, **reads: Any) -> None:
    """Write a figure's table and, drawn from that, the figure, by its module."""
    figure = import_module(f"study.{module}")
    save_csv(figure.table(**reads, **arguments), csv)
    figure.draw(csv, svg)


def drawings(study: Fields) -> dict[str, Drawing]:
    """All figures, by their names."""
    return {figure: drawing for name in study["figures"] for figure, drawing in _of_entry(name, study)}


def shown(study: Fields) -> list[tuple[list[str], str]]:
    """The names of each entry's figures, and what they show."""
    return [
        ([figure for figure, _ in _of_entry(name, study)], entry["shows"])
        for name, entry in study["figures"].items()
    ]


def _of_entry(name: str, study: Fields) -> Iterator[tuple[str, Drawing]]:
    entry = study["figures"][name]
    for scene in entry["scenes"] or [""]:
        yield f"{name}{'_' if scene else ''}{scene}", _drawing(entry, scene, study)


def _drawing(entry: Fields, scene: str, study: Fields) -> Drawing:
    given = entry["parameters"]
    cases = [*given.get("cases", []), *([given["case"]] if "case" in given else [])]
    return Drawing(
        module=registry.figures()[entry["module"]],
        shows=entry["shows"],
        reads={key: _files(files, scene, study["surveys"]) for key, files in entry["reads"].items()},
        arguments={key: _fields(where, scene, study) for key, where in entry["study"].items()} | given,
        cases=list(dict.fromkeys(cases)),
    )


def _files(given: str | list[str], scene: str, surveys: Fields) -> str | list[str]:
    if isinstance(given, str) and "{surveys}" not in given:
        return given.format(scene=scene)
    paths = [given] if isinstance(given, str) else given
    files = [path.format(scene=scene, surveys=survey) for path in paths for survey in surveys]
    return list(dict.fromkeys(files))


def _fields(where: str | list[str], scene: str, study: Fields) -> Any:
    """The field of the configuration with a path such as cost.base, or the fields with such paths."""
    if isinstance(where, list):
        return [_fields(each, scene, study) for each in where]
    return reduce(lambda held, name: held[name], where.format(scene=scene).split("."), study)


def faults(study: Fields) -> Iterator[tuple[Place, str]]:
    """Where an entry names something that does not exist, and what is wrong.

    Faults are found one after the other, since the second check relies on the first.
    """
    for name, entry in study["figures"].items():
        for place, said in chain(_unknown(entry, study), _unfit(name, entry, study)):
            yield ("figures", name, *place), said


def _unknown(entry: Fields, study: Fields) -> Iterator[tuple[Place, str]]:
    """Faults: a module or a field of the configuration that does not exist."""
    if entry["module"] not in (known := registry.figures()):
        yield ("module",), f"it is '{entry['module']}'; it has to be one of {', '.join(known)}"
    for key, where in entry["study"].items():
        for scene in entry["scenes"] or [""]:
            try:
                _fields(where, scene, study)
            except (KeyError, TypeError):
                yield ("study", key), f"it is {where}; the configuration has no such field"


def _unfit(name: str, entry: Fields, study: Fields) -> Iterator[tuple[Place, str]]:
    """Faults: results or cases that do not exist, and arguments that the module's `table` does not take."""
    folders = (*study["scenes"], *study["surveys"], *registry.experiments())
    for _, drawing in _of_entry(name, study):
        read = [(key, folder) for key, files in drawing.reads.items() for folder in _folders(files)]
        for key, folder in read:
            if folder not in folders:
                yield ("reads", key), f"there are no results of '{folder}'"
        known = {case for _, folder in read for case in study["scenes"].get(folder, {"cases": []})["cases"]}
        for case in drawing.cases:
            if read and case not in known:
                yield ("parameters",), f"'{case}' is a case of no scene that is read"
    yield from _not_taken(entry)


def _folders(files: str | list[str]) -> list[str]:
    """The folders in results/ that hold these files."""
    parts = [path.split("/") for path in ([files] if isinstance(files, str) else files)]
    return [part[1] for part in parts if len(part) == 3]


def _not_taken(entry: Fields) -> Iterator[tuple[Place, str]]:
    module, given = entry["module"], [*entry["reads"], *entry["study"], *entry["parameters"]]
    of_module = registry.functions(registry.figures()[module])
    if not {"table", "draw"} <= set(of_module):
        yield ("module",), f"{module} has to have the functions `table` and `draw`"
        return
    table = of_module["table"]
    taken = [*table.needed, *table.optional]
    if not set(table.needed) <= set(given) <= set(taken) or len(given) > len(set(given)):
        names = ", ".join(map(errors.shown, given))
        yield (), f"`table` of {module} is given {names}; it takes {', '.join(taken)}"
