"""Records for programs, as JSON."""

from __future__ import annotations

import json
import math
import os
from typing import Any

from unilateral.system.files import replacing


def encode_json(record: dict[str, Any]) -> str:
    """One JSON object, with null for what is no finite number."""
    return json.dumps(_replace_nonfinite(record))


def write_json(record: dict[str, Any], path: str | os.PathLike[str]) -> None:
    """Writes a record as one JSON object to a file."""
    with replacing(path) as temporary:
        temporary.write_text(encode_json(record) + "\n", encoding="utf-8", newline="\n")


def _replace_nonfinite(value: Any) -> Any:
    """The value with null for NaN and infinite numbers, which JSON does not have; tuples become lists."""
    if isinstance(value, dict):
        return {key: _replace_nonfinite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_replace_nonfinite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
