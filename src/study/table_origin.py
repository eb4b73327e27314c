"""What a table belongs to and what it was made with, as its file tells, and whether that is still so.

A table's place is its folder and its name, such as square/rates. Its parameters are fields of the
configuration by their paths, such as scenes.square.mesh.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import Any

from unilateral.errors import shown

OF_THE_MACHINE = "timings.nc"
"""Files that hold seconds and memory have names that end like this; no two runs make the same ones."""

_rule: ContextVar[str] = ContextVar("rule", default="")


@contextmanager
def made_by(rule: str) -> Iterator[None]:
    """Within this context, tables are stamped as made by that rule."""
    token = _rule.set(rule)
    try:
        yield
    finally:
        _rule.reset(token)


def place(path: str | os.PathLike[str]) -> str:
    """The place of a table in a file."""
    whole = Path(path).absolute()
    return f"{whole.parent.name}/{whole.stem}"


def stamp(path: str | os.PathLike[str], parameters: Mapping[str, Any] | None) -> dict[str, str]:
    """The attributes of a table that is written there, with those parameters."""
    told = json.dumps(parameters or {}, sort_keys=True)
    return {"table": place(path), "rule": _rule.get(), "parameters": told}


def fault(path: str | os.PathLike[str], attrs: Mapping[str, Any], study: Mapping[str, Any] | None) -> str:
    """Why the table with these attributes is not the one of that path and, if given, that configuration."""
    if "table" not in attrs:
        return f"is of a version that did not tell its place, and '{place(path)}' is expected"
    if attrs["table"] != place(path):
        return f"is the table '{attrs['table']}', and '{place(path)}' is expected"
    if study is not None:
        for name, made_with in json.loads(attrs["parameters"]).items():
            configured: Any = study
            for part in name.split("."):
                configured = _parts(configured).get(part)
            for where, old, new in _differences(name, made_with, configured):
                return f"was made with {where}: {_told(old)}, and the configuration has {_told(new)}"
    return ""


def _parts(held: Any) -> dict[str, Any]:
    """What a field holds, by the names or the numbers of its parts."""
    if isinstance(held, list):
        return {str(i): part for i, part in enumerate(held)}
    return held if isinstance(held, dict) else {}


def _differences(path: str, old: Any, new: Any) -> Iterator[tuple[str, Any, Any]]:
    """The innermost fields that differ, with both values; None stands for a field that is not there."""
    one = _parts(old)
    other = _parts(new)
    if one and other:
        for name in dict.fromkeys([*one, *other]):
            yield from _differences(f"{path}.{name}", one.get(name), other.get(name))
    elif old != new:
        yield path, old, new


def _told(value: Any) -> str:
    return "nothing" if value is None else shown(json.dumps(value))
