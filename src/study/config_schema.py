"""The check of the study's configuration by its schemas: defaults are filled in, faults told in words.

The schema of an experiment's own fields is the file `schema.yaml` in its folder.
"""

from __future__ import annotations

import itertools
import math
import operator
import reprlib
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import jsonschema

from study import registry
from unilateral.errors import InputError
from unilateral.formulas.formula import real
from unilateral.geometry import polygon
from unilateral.system.declarations import MAX_DEPTH, MAX_DIGITS, own

FILE = "schema.yaml"
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
OWN_LIMITS = {
    "least": (operator.ge, "at least {}"),
    "most": (operator.le, "at most {}"),
    "below": (operator.lt, "below {}"),
}
"""Our keywords for numbers and fractions: how they compare with a limit, and what they ask for."""
ORDERS = {"falling": (operator.gt, "smaller"), "rising": (operator.lt, "larger")}


def faults(study: dict[str, Any], schema: str) -> Iterator[tuple[tuple[str | int, ...], str]]:
    """Where the study is not as the schemas say, and what would be right; fills in their defaults.

    What no file may hold is told first: it may be given with `--config` instead, and jsonschema fails on it.
    """
    yield from _beyond(study)
    rules, scenes = _rules(schema), study.get("scenes")
    names = {"scene": list(scenes) if isinstance(scenes, dict) else [], "polygon": polygon.names()}
    known = {name: {**rules["$defs"][name], "enum": of} for name, of in names.items()}
    for fault in _Validator({**rules, "$defs": rules["$defs"] | known}).iter_errors(study):
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
def _rules(schema: str) -> dict[str, Any]:
    """The schema in that file, with those of the experiments; all that these declare is required."""
    rules: dict[str, Any] = own(Path(schema))
    for name in registry.experiments():
        file = registry.STUDY / "experiments" / name / FILE
        declared = own(file) if file.is_file() else {}
        rules["properties"] |= declared
        rules["required"] += declared
    folder = rules["$defs"]["folder"]
    folder["description"] = folder["description"].format(taken=", ".join(folder["not"]["enum"]))
    folder["not"]["enum"] += registry.experiments()
    return rules


def _said(fault: Any) -> str:
    """What is wrong, and what would be right."""
    if fault.validator is None:
        return "it has no place here"
    if fault.validator == "order":
        return f"each number has to be {ORDERS[fault.validator_value][1]} than the one before it"
    if fault.validator in OWN_LIMITS:
        wanted = OWN_LIMITS[fault.validator][1].format(fault.validator_value)
        return f"it is {fault.instance}; it has to be {wanted}"
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
    kinds = schema.get("type", [])
    named = [TYPES[kind] for kind in ([kinds] if isinstance(kinds, str) else kinds)]
    return ", ".join([" or ".join(named), *limits] if named else limits)


def _set_defaults(validator: Any, properties: Any, instance: Any, schema: Any) -> Iterator[Any]:
    """jsonschema's `properties`, which first fills in what is left out."""
    usual = jsonschema.Draft202012Validator.VALIDATORS["properties"]
    if isinstance(instance, dict):
        for name, rules in properties.items():
            if isinstance(rules, dict) and "default" in rules:
                instance.setdefault(name, rules["default"])
    yield from usual(validator, properties, instance, schema)


def _ordered(_: Any, order: str, instance: Any, schema: Any) -> Iterator[Any]:
    """Whether each number is beyond the one before it."""
    sizes = [_real(each) for each in instance] if isinstance(instance, list) else []
    if not all(ORDERS[order][0](a, b) for a, b in itertools.pairwise(sizes)):
        yield jsonschema.ValidationError(order)


def _limited(keyword: str) -> Any:
    """Whether a number or a fraction keeps a limit."""

    def check(_: Any, limit: object, instance: object, schema: Any) -> Iterator[Any]:
        value = _real(instance)
        if not (math.isnan(value) or OWN_LIMITS[keyword][0](value, _real(limit))):
            yield jsonschema.ValidationError(keyword)

    return check


def _real(given: object) -> float:
    """The value of a number or a fraction; NaN for anything else, which other keywords refuse."""
    try:
        return real(given, "")
    except InputError:
        return math.nan


def _finite(_: object, value: object) -> bool:
    """Whether a value is a finite number; JSON has no other numbers, and true and false are none."""
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _whole(_: object, value: object) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)


_Validator = jsonschema.validators.extend(
    jsonschema.Draft202012Validator,
    {"properties": _set_defaults, "order": _ordered, **{name: _limited(name) for name in OWN_LIMITS}},
    type_checker=jsonschema.Draft202012Validator.TYPE_CHECKER.redefine_many(
        {"number": _finite, "integer": _whole}
    ),
)
