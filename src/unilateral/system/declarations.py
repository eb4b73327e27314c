"""Reads YAML files that declare something, and checks them against a JSON schema.

Plain scalars mean what they look like: null, true, false and decimal whole numbers are these; anything else
is text, so that 0.1 stays exact and 010, 0x10, 1:30, yes or a date are not read as another number or value.
"""

from __future__ import annotations

import math
import re
from functools import cache
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any

import yaml
from yaml.composer import Composer
from yaml.constructor import SafeConstructor
from yaml.cyaml import CParser  # type: ignore[attr-defined]
from yaml.resolver import Resolver

from unilateral.errors import InputError, quote_input

YAML_ENDINGS = (".yaml", ".yml")
MAX_BYTES = 200_000
MAX_YAML_NODES = 10_000
"""A file has at most this many values, lists and fields."""
MAX_DEPTH = 10
"""Lists and fields are at most this deep in each other; no schema needs half of it."""
MAX_INTEGER_DIGITS = 18
"""Whole numbers have at most this many digits: any of these fits into 64 bits."""
INTEGER_PATTERN = re.compile(rf"[-+]?(0|[1-9][0-9]{{0,{MAX_INTEGER_DIGITS - 1}}})\Z")
"""What is read as a whole number."""
JOINED_COLON_PATTERN = re.compile(r"^\s*([A-Za-z_]\w*):([^\s:].*)$", re.MULTILINE)
"""The name of a field whose colon has no blank after it."""
DESCRIBED_KEYWORDS = ("type", "anyOf", "oneOf", "pattern", "minItems", "maxItems")
"""The keywords of a schema for which its description says what would be right."""
TYPE_DESCRIPTIONS = {
    "array": "a list",
    "boolean": "true or false",
    "integer": "a whole number such as 3",
    "object": "a mapping",
}


def find_yaml_file(name: str) -> Path | None:
    """The YAML file that a user names, None for what can only be the name of a case.

    Raises InputError for a folder, a file with another ending, and a file that is not there.
    """
    path = Path(name)
    try:
        is_file = path.is_file()
        is_folder = name != "" and path.is_dir()
    except OSError as error:
        raise InputError(f"{quote_input(name)} cannot be read: {error.strerror}") from None
    if is_folder:
        raise InputError(f"{name} is a folder; name a YAML file, or a case")
    if name.endswith(YAML_ENDINGS):
        if not is_file:
            missing = f"there is no file {name}"
            beside = _find_same_stem(path)
            raise InputError(f"{missing}; did you mean {beside}?" if beside else missing)
        return path
    if is_file:
        raise InputError(f"{name} does not end in .yaml or .yml; rename it if it is a YAML file")
    if beside := _find_same_stem(path):
        raise InputError(f"there is no case and no file {name}; did you mean {beside}?")
    return None


def _find_same_stem(path: Path) -> Path | None:
    """The YAML file beside a path that has its name, but for the ending."""
    if not path.name:
        return None
    names = (f"{stem}{ending}" for stem in (path.name, path.stem) for ending in YAML_ENDINGS)
    return next((file for file in map(path.with_name, names) if file.is_file()), None)


def read_declaration(file: Path | Traversable, name: str, floats: bool = False) -> Any:
    """Content of a user's YAML file, with decimal fractions as text or as floats.

    Raises InputError if it is no YAML file or beyond the limits, if a field is given twice, of which YAML
    would keep the last one, and for anchors, aliases and tags.
    """
    try:
        with file.open("rb") as stream:
            content = stream.read(MAX_BYTES + 1)
        if len(content) > MAX_BYTES:
            raise InputError(f"{name} has more than {MAX_BYTES} bytes; a case or a problem needs less")
        return (_FloatLoader if floats else _Loader)(content.decode("utf-8")).get_single_data()
    except OSError as error:
        raise InputError(f"{name} cannot be read: {error.strerror}") from None
    except _RefusedError as error:
        raise InputError(f"{name}: {error}") from None
    except (yaml.YAMLError, ValueError) as error:
        raise InputError(
            f"{name} is not a YAML file: {_describe_yaml_error(error, content.decode('utf-8', 'replace'))}"
        ) from None


def validate(declaration: Any, schema: Traversable | dict[str, Any], name: str) -> dict[str, Any]:
    """The declaration if it is as the schema, or its file, says; raises InputError with the field if not."""
    from jsonschema.exceptions import best_match

    validator = _make_validator(schema) if isinstance(schema, dict) else _load_validator(schema)  # type: ignore[arg-type]
    fault = best_match(validator.iter_errors(declaration))
    if fault is not None:
        path = fault.json_path.removeprefix("$.").replace("['", "[").replace("']", "]")
        place = f", field {quote_input(path)}" if fault.path else ""
        raise InputError(f"{name}{place}: {_describe_violation(fault)}")
    return declaration


@cache
def _load_validator(schema: Traversable) -> Any:
    return _make_validator(read_stored_yaml(schema))


def _make_validator(schema: dict[str, Any]) -> Any:
    """A validator of JSON Schema for which numbers are finite, and 4.0 is no whole number."""
    from jsonschema import Draft202012Validator
    from jsonschema.validators import extend

    types = Draft202012Validator.TYPE_CHECKER.redefine_many({"number": _is_finite, "integer": _is_whole})
    return extend(Draft202012Validator, type_checker=types)(schema)


def _is_finite(_: object, value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _is_whole(_: object, value: object) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)


def read_stored_yaml(file: Path | Traversable) -> Any:
    """Content of one of this project's own YAML files, with plain scalars as YAML reads them."""
    return yaml.load(file.read_text(encoding="utf-8"), yaml.CSafeLoader)


def _describe_yaml_error(error: Exception, content: str) -> str:
    """The parser's error in a line, or a sentence on a tab or a missing blank."""
    place = getattr(error, "problem_mark", None)
    if place and content[place.index : place.index + 1] == "\t":
        return f"there is a tab in line {place.line + 1}; write spaces"
    if joined := JOINED_COLON_PATTERN.search(content):
        line = content.count("\n", 0, joined.end()) + 1
        correct = quote_input(": ".join(joined.groups()))
        return f"the colon in line {line} needs a blank after it; write {correct}"
    return " ".join(str(error).split()).replace(' "<unicode string>",', "")


def _describe_violation(violation: Any) -> str:
    """Sentence on what is wrong with a field, by the validator's error, and what would be right."""
    if violation.validator == "required":
        missing = next(name for name in violation.validator_value if name not in violation.instance)
        description = violation.schema.get("properties", {}).get(missing, {}).get("description")
        return f"the field {missing} is missing" + (f"; it holds {description}" if description else "")
    if violation.validator is None:
        return "this field is not allowed here"
    if violation.validator in DESCRIBED_KEYWORDS and "description" in violation.schema:
        value = "null" if violation.instance is None else quote_input(violation.instance)
        return f"it is {value}; it has to be {violation.schema['description']}"
    if violation.validator != "additionalProperties":
        message = str(violation.message).replace(
            repr(violation.instance), quote_input(repr(violation.instance))
        )
        type_description = violation.validator == "type" and TYPE_DESCRIPTIONS.get(violation.validator_value)
        return f"{message}; write {type_description}" if type_description else message
    fields = violation.schema["properties"]
    unknown = min(set(violation.instance) - set(fields))
    if unknown.partition(":")[0] in fields:
        return f"the colon in '{quote_input(unknown)}' needs a blank after it"
    return f"there is no field '{quote_input(unknown)}' here; the fields are {', '.join(fields)}"


def _name_line(node: yaml.Event | yaml.Node) -> str:
    return f"in line {getattr(node.start_mark, 'line', 0) + 1}"


class _RefusedError(Exception):
    """The file is YAML, but has more than is read here."""


class _Loader(Composer, CParser, SafeConstructor, Resolver):
    """All names of fields are text; limits are looked at while the file is read, before anything is built."""

    def __init__(self, text: str) -> None:
        CParser.__init__(self, text)
        for base in (Composer, SafeConstructor, Resolver):
            base.__init__(self)

    yaml_implicit_resolvers: dict[str, list[tuple[str, re.Pattern[str]]]] = {}  # noqa: RUF012
    nodes = depth = 0

    def get_event(self) -> yaml.Event | None:
        """The next event of the parser, if it is within the limits."""
        event = super().get_event()
        if isinstance(event, yaml.NodeEvent):
            self._check_limits(event)
        self.depth -= isinstance(event, yaml.CollectionEndEvent)
        return event

    def _check_limits(self, event: yaml.NodeEvent) -> None:
        self.nodes += 1
        self.depth += isinstance(event, yaml.CollectionStartEvent)
        if self.nodes > MAX_YAML_NODES:
            raise _RefusedError(f"it has more than {MAX_YAML_NODES} values")
        if self.depth > MAX_DEPTH:
            raise _RefusedError(f"it has more than {MAX_DEPTH} nested lists or fields")
        line = _name_line(event)
        if event.anchor is not None:
            raise _RefusedError(
                f"'{quote_input(event.anchor)}' {line} is an anchor or alias; write the value itself"
            )
        tag = getattr(event, "tag", None)
        if tag is not None:
            raise _RefusedError(f"'{quote_input(tag)}' {line} is a tag; write the value alone")

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        """The mapping with names that are text; _RefusedError for a name that is given twice."""
        names = set()
        for key, _ in node.value:
            if not isinstance(key, yaml.ScalarNode):
                raise _RefusedError(f"the name of the field {_name_line(key)} is not a text")
            if key.value in names:
                raise _RefusedError(
                    f"'{quote_input(key.value)}' is given twice, again {_name_line(key)}; give it once"
                )
            names.add(key.value)
            key.tag = "tag:yaml.org,2002:str"  # a name is text, also if it looks like a number
        return super().construct_mapping(node, deep)


class _FloatLoader(_Loader):
    """A loader for which decimal fractions, with or without an exponent, are numbers."""


_FloatLoader.yaml_implicit_resolvers = {}
for _tag, _pattern, _first in (
    ("null", re.compile(r"(~|null|)\Z"), ["~", "n", ""]),
    ("bool", re.compile(r"(true|false)\Z"), ["t", "f"]),
    ("int", INTEGER_PATTERN, list("-+0123456789")),
):
    for _loader in (_Loader, _FloatLoader):
        _loader.add_implicit_resolver(f"tag:yaml.org,2002:{_tag}", _pattern, _first)
_FLOAT = re.compile(r"[-+]?([0-9]+\.[0-9]*|\.[0-9]+|[0-9]+(?=[eE]))([eE][-+]?[0-9]+)?\Z")
_FloatLoader.add_implicit_resolver("tag:yaml.org,2002:float", _FLOAT, list("-+.0123456789"))
