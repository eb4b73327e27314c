"""Copies and pickles of objects that cache what they compute."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any


class Rebuilt:
    """A dataclass whose copies and pickles are made of its fields, without what was computed from them.

    >>> import copy
    >>> from unilateral.geometry.polygon import square
    >>> copy.copy(square()).area
    1.0
    """

    def __reduce__(self) -> tuple[Any, ...]:
        named = {field.name: getattr(self, field.name) for field in fields(self)}  # type: ignore[arg-type]
        return rebuilt, (type(self), named)


def rebuilt(kind: type, named: Mapping[str, Any]) -> Any:
    """The object of that kind with the fields `named`."""
    return kind(**named)
