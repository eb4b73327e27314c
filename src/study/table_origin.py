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

from unilateral.errors import quote_input

TIMINGS_ENDING = "timings.nc"
"""Files that hold seconds and memory have names that end like this; no two runs make the same ones."""

_current_rule: ContextVar[str] = ContextVar("rule", default="")


@contextmanager
def stamp_rule(rule: str) -> Iterator[None]:
    """Within this context, tables are stamped as made by that rule."""
    token = _current_rule.set(rule)
    try:
        yield
    finally:
        _current_rule.reset(token)


def table_place(path: str | os.PathLike[str]) -> str:
    """The place of a table in a file."""
    absolute_path = Path(path).absolute()
    return f"{absolute_path.parent.name}/{absolute_path.stem}"


def origin_attributes(path: str | os.PathLike[str], parameters: Mapping[str, Any] | None) -> dict[str, str]:
    """The attributes of a table that is written there, with those parameters."""
    parameter_text = json.dumps(parameters or {}, sort_keys=True)
    return {"table": table_place(path), "rule": _current_rule.get(), "parameters": parameter_text}


def origin_fault(
    path: str | os.PathLike[str], attrs: Mapping[str, Any], study: Mapping[str, Any] | None
) -> str:
    """Why the table with these attributes is not the one of that path and, if given, that configuration."""
    if "table" not in attrs:
        return f"is of a version that did not tell its place, and '{table_place(path)}' is expected"
    if attrs["table"] != table_place(path):
        return f"is the table '{attrs['table']}', and '{table_place(path)}' is expected"
    if study is not None:
        for name, made_with in json.loads(attrs["parameters"]).items():
            configured: Any = study
            for field in name.split("."):
                configured = _nested_fields(configured).get(field)
            for where, old, new in _find_differing_fields(name, made_with, configured):
                stored = _format_field(old)
                return f"was made with {where}: {stored}, and the configuration has {_format_field(new)}"
    return ""


def _nested_fields(value: Any) -> dict[str, Any]:
    """Nested fields or items of a value, by their names or numbers; empty for a single value."""
    if isinstance(value, list):
        return {str(i): item for i, item in enumerate(value)}
    return value if isinstance(value, dict) else {}


def _find_differing_fields(path: str, old: Any, new: Any) -> Iterator[tuple[str, Any, Any]]:
    """The innermost fields that differ, with both values; None stands for a field that is not there."""
    old_fields = _nested_fields(old)
    new_fields = _nested_fields(new)
    if old_fields and new_fields:
        for name in dict.fromkeys([*old_fields, *new_fields]):
            yield from _find_differing_fields(f"{path}.{name}", old_fields.get(name), new_fields.get(name))
    elif old != new:
        yield path, old, new


def _format_field(value: Any) -> str:
    return "nothing" if value is None else quote_input(json.dumps(value))
