"""YAML files that declare something, read and held against a JSON schema."""

from __future__ import annotations

from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any

import jsonschema
import yaml

from unilateral.errors import InputError


def read(file: Path | Traversable, name: str) -> Any:
    """What a YAML file holds.

    Raises InputError if it is none or if a field is given twice, of which YAML would keep the last one.
    """
    try:
        return yaml.load(file.read_text(encoding="utf-8"), _Loader)
    except OSError as error:
        raise InputError(f"{name} cannot be read: {error.strerror}") from None
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise InputError(f"{name} is not a YAML file: {' '.join(str(error).split())}") from None


def validate(declaration: Any, schema: Traversable, name: str) -> dict[str, Any]:
    """The declaration if it is as the schema's file says; raises InputError with the field if not."""
    rules = yaml.safe_load(schema.read_text(encoding="utf-8"))
    fault = jsonschema.exceptions.best_match(jsonschema.Draft202012Validator(rules).iter_errors(declaration))
    if fault is not None:
        place = ", field " + fault.json_path.removeprefix("$.") if fault.path else ""
        raise InputError(f"{name}{place}: {_said(fault)}")
    return declaration


def _said(fault: Any) -> str:
    if fault.validator in ("type", "anyOf", "minItems", "maxItems") and "description" in fault.schema:
        return f"it is {str(fault.instance)[:40]}; it has to be {fault.schema['description']}"
    if fault.validator != "additionalProperties":
        return str(fault.message)
    known = fault.schema["properties"]
    unknown = sorted(str(key) for key in set(fault.instance) - set(known))
    return f"there is no field '{unknown[0]}' here; the fields are {', '.join(known)}"


class _Loader(yaml.SafeLoader):
    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        keys = [key.value for key, _ in node.value]
        for key in keys:
            if keys.count(key) > 1:
                raise yaml.YAMLError(f"the field '{key}' is given twice")
        return super().construct_mapping(node, deep)
