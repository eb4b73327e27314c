"""The records of the ledger's claims, as they are stored, and the margins that are told apart."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from hashlib import sha256
from pathlib import Path
from typing import Any

from unilateral.errors import StorageError

MANIFEST = "manifest.json"
FAILS = "fails"
UNJUDGED = "not judged"
UNMEASURED = "nothing to measure"
"""No document may rest on these verdicts; in the last two a reason follows."""
ORIGINS = {
    "derived": "derived",
    "tolerance": "derived up to a tolerance",
    "taken": "taken from another source",
    "before": "set before values were known",
    "after": "set after values had been seen",
}
"""The origin of a required number, by a short name; a claim's source begins with such a text and a colon."""
MIN_TOLD_MARGIN = 1e-4
MAX_TOLD_MARGIN = 10.0
"""A margin below the first number or above the second is told as lying below or above it."""


def format_margin(margin: float) -> str:
    """A margin for readers: at most two digits, and none where it is too small or too large to tell."""
    margin = float(f"{margin:.2g}")
    if abs(margin) >= MAX_TOLD_MARGIN:
        return f"> {100 * MAX_TOLD_MARGIN:.0f} %" if margin > 0 else f"< -{100 * MAX_TOLD_MARGIN:.0f} %"
    if 0 <= margin < MIN_TOLD_MARGIN:
        return f"< {100 * MIN_TOLD_MARGIN:g} %"
    digits = 2 if abs(margin) < 0.01 else 0
    return f"{100 * margin:.{digits}f} %"


def verdict_holds(verdict: str) -> bool:
    """Whether a sentence may rest on a claim with that verdict."""
    return not verdict.startswith((FAILS, UNJUDGED, UNMEASURED))


def verdict_counts_against(verdict: str) -> bool:
    """Whether there is something to measure and it does not hold."""
    return verdict.startswith((FAILS, UNJUDGED))


def read_records(path: str | os.PathLike[str]) -> Any:
    """Content of a JSON file, such as the claims' records. Raises StorageError if it is damaged.

    Raises StorageError for a file that is damaged.
    """
    try:
        return json.loads(Path(path).read_text(encoding="utf-8"))
    except ValueError:
        raise StorageError(f"{path} is damaged; 'snakemake -j2 -f {path}' makes it anew") from None


def source_origin(source: str) -> str:
    """The short name of where the number comes from. Raises KeyError if it is unknown."""
    return {text: name for name, text in ORIGINS.items()}[source.partition(":")[0]]


def read_listed_digests(folder: str | os.PathLike[str]) -> dict[str, str]:
    """The SHA-256 of the files in a folder of results, by their paths in it; empty without a manifest.

    Raises StorageError for a manifest that is none.
    """
    manifest = Path(folder, MANIFEST)
    if not manifest.is_file():
        return {}
    record = read_records(manifest)
    try:
        return {entry["path"].partition("/")[2]: entry["sha256"] for entry in record["files"]}
    except (KeyError, TypeError, AttributeError) as error:
        raise StorageError(
            f"{manifest} is not the manifest of a study; 'snakemake -j2 -f {manifest}' makes it anew"
        ) from error


def check_listed_digest(folder: str | os.PathLike[str], name: str, listed_digests: Mapping[str, str]) -> None:
    """Raises StorageError for a file in the folder of which another SHA-256 is listed."""
    path = Path(folder, name)
    digest = sha256(path.read_bytes()).hexdigest()
    if (listed := listed_digests.get(name, digest)) != digest:
        raise StorageError(
            f"{path} is another version than the study ended with: its SHA-256 is {digest[:16]}..., and "
            f"{Path(folder, MANIFEST)} has {listed[:16]}...; 'snakemake -j2 -f {path}' makes it anew"
        )
