"""The records of the ledger's claims, as they are stored, and the margins that are told apart."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

from unilateral.errors import StorageError

FAILS, UNJUDGED, UNMEASURED = "fails", "not judged", "nothing to measure"
"""No document may rest on these verdicts; in the last two a reason follows."""
ORIGINS = {
    "derived": "derived",
    "tolerance": "derived up to a tolerance",
    "taken": "taken from another source",
    "before": "set before values were known",
    "after": "set after values had been seen",
}
"""The origin of a required number, by a short name; a claim's source begins with such a text and a colon."""
LEAST, PLENTY = 1e-4, 10.0
"""A margin below the first number or above the second is told as lying below or above it."""


def percent(margin: float) -> str:
    """A margin for readers: no more than two digits, and none beyond LEAST and PLENTY."""
    margin = float(f"{margin:.2g}")
    if abs(margin) >= PLENTY:
        return f"> {100 * PLENTY:.0f} %" if margin > 0 else f"< -{100 * PLENTY:.0f} %"
    if 0 <= margin < LEAST:
        return f"< {100 * LEAST:g} %"
    digits = 2 if abs(margin) < 0.01 else 0
    return f"{100 * margin:.{digits}f} %"


def holds(verdict: str) -> bool:
    """Whether a sentence may rest on a claim with that verdict."""
    return not verdict.startswith((FAILS, UNJUDGED, UNMEASURED))


def read(path: str | os.PathLike[str]) -> Any:
    """What is stored as JSON, such as the records of `results/claims.json`.

    Raises StorageError for a file that is damaged.
    """
    try:
        return json.loads(Path(path).read_text(encoding="utf-8"))
    except ValueError:
        raise StorageError(f"{path} is damaged; 'snakemake -j2 -f {path}' makes it anew") from None


def origin(source: str) -> str:
    """The short name of where the number comes from. Raises KeyError if it is unknown."""
    return {text: name for name, text in ORIGINS.items()}[source.partition(":")[0]]
