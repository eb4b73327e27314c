"""The check of the study's configuration by its schema: defaults are filled in, faults told in words."""

from __future__ import annotations

import math
import reprlib
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import jsonschema

from unilateral.geometry import polygon
from unilateral.study import registry
from unilateral.system.declarations import MAX_DEPTH, MAX_DIGITS, own

TYPES = {
    "array": "a list",
    "boolean": "true or false",
    "integer": "a whole number",
    "number": "a number",
    "object": "a mapping",
    "string": "a text",
}
LIMITS = {
    "minimum": "at least {}",
    "exclusiveMinimum": "above {}",
    "maximum": "at most {}",
    "minItems": "at least {} long",
    "minProperties": "at least {} long",
    "minLength": "at least {} long",
    "uniqueItems": "without an entry twice",
}


def faults(study: dict[str, Any], schema: str) -> Iterator[tuple[tuple[str | int, ...], str]]:
    """Where the study is not as the schema's file says, and what would be right; fills in its defaults.

    What no file may hold is told first: it may be given with `--config` instead, and jsonschema fails on it.
    """
    yield from _beyond(study)
    for fault in _validator(schema).iter_errors(study):
        yield tuple(fault.absolute_path), _said(fault)


def _beyond(study: Any) -> Iterator[tuple[tuple[str | int, ...], str]]:
    """Where numbers are longer or lists deeper than a file may have them."""
    waiting: list[tuple[tuple[str | int, ...], Any]] = [((), study)]
    while waiting:
        place, value = waiting.pop()
        if isinstance(value, int) and abs(value) >= 10**MAX_DIGITS:
            yield place, f"it has more than {MAX_DIGITS} digits"
        elif isinstance(value, dict | list) and len(place) >= MAX_DEPTH:
            yield place, f"it is in more than {MAX_DEPTH} lists or fields"
        elif isinstance(value, dict | list):
            parts = value.items() if isinstance(value, dict) else enumerate(value)
            waiting += [((*place, name), part) for name, part in parts]


@cache
def _validator(schema: str) -> Any:
    """The validator of a schema; it allows the polygons and the kinds of axes that the library has."""
    rules = own(Path(schema))
    rules["$defs"]["polygon"]["enum"] = polygon.names()
    rules["$defs"]["kind"]["enum"] = list(registry.axes())
    return _Validator(rules)


def _said(fault: Any) -> str:
    """What is wrong, and what would be right."""
    if fault.validator is None:
        return "it has no place here"
    if fault.validator == "required":
        missing = next(name for name in fault.validator_value if name not in fault.instance)
        return f"the field '{missing}' is missing"
    if fault.validator == "additionalProperties":
        known = fault.schema["properties"]
        unknown = next(name for name in fault.instance if name not in known)
        return f"there is no field {reprlib.repr(unknown)} here; the fields are {', '.join(known)}"
    subject = "a name in it" if "propertyNames" in fault.relative_schema_path else "it"
    return f"{subject} is {reprlib.repr(fault.instance)}; it has to be {_wanted(fault.schema)}"


def _wanted(schema: Mapping[str, Any]) -> str:
    """What a schema allows, in words; for patterns and alternatives these are the schema's description."""
    if {"pattern", "anyOf", "oneOf"} & set(schema):
        return str(schema["description"])
    if "enum" in schema:
        return "one of " + ", ".join(schema["enum"])
    if "const" in schema:
        return str(schema["const"])
    limits = [said.format(schema[name]) for name, said in LIMITS.items() if name in schema]
    return ", ".join([TYPES[schema["type"]], *limits])


def _set_defaults(validator: Any, properties: Any, instance: Any, schema: Any) -> Iterator[Any]:
    """jsonschema's `properties`, which first fills in what is left out."""
    usual = jsonschema.Draft202012Validator.VALIDATORS["properties"]
    if isinstance(instance, dict):
        for name, rules in properties.items():
            if isinstance(rules, dict) and "default" in rules:
                instance.setdefault(name, rules["default"])
    yield from usual(validator, properties, instance, schema)


def _finite(_: object, value: object) -> bool:
    """Whether a value is a finite number; JSON has no other numbers, and true and false are none."""
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _whole(_: object, value: object) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)


_Validator = jsonschema.validators.extend(
    jsonschema.Draft202012Validator,
    {"properties": _set_defaults},
    type_checker=jsonschema.Draft202012Validator.TYPE_CHECKER.redefine_many(
        {"number": _finite, "integer": _whole}
    ),
)
