"""What the experiments declare of every claim, in the order of the paper."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from unilateral.errors import InputError
from unilateral.system.declarations import own

SECTIONS = Path(__file__).with_name("sections.yaml")
FILE = "claims.yaml"
"""The file in an experiment's folder that declares its claims."""


def entries() -> list[dict[str, Any]]:
    """The claims as they are declared, each with its section, section by section.

    Raises InputError unless every claim is declared once and named once in sections.yaml.
    """
    declared = [entry for file in files() for entry in own(file)["claims"]]
    sections = own(SECTIONS)
    known = [entry["id"] for entry in declared]
    named = [each for ids in sections.values() for each in ids]
    for each in dict.fromkeys([*known, *named]):
        if known.count(each) != 1 or named.count(each) != 1:
            raise InputError(
                f"ledger, claim '{each}': it has to be declared once, in the {FILE} of an experiment, and "
                "named once in sections.yaml"
            )
    by_id = dict(zip(known, declared, strict=True))
    return [by_id[each] | {"section": section} for section, ids in sections.items() for each in ids]


def files() -> list[Path]:
    """The files of the experiments' claims, by the names of the experiments."""
    return sorted(SECTIONS.parents[1].glob(f"experiments/*/{FILE}"))
