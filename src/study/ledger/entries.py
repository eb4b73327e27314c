"""What the experiments declare of every claim, in the order of the paper."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from unilateral.errors import InputError
from unilateral.system.declarations import read_stored_yaml

SECTIONS_FILE = Path(__file__).with_name("sections.yaml")
CLAIMS_FILE = "claims.yaml"
"""The file in an experiment's folder that declares its claims."""


def read_entries() -> list[dict[str, Any]]:
    """The claims as they are declared, each with its section, section by section.

    Raises InputError unless every claim is declared once and named once in sections.yaml.
    """
    declared = [entry for file in claims_files() for entry in read_stored_yaml(file)["claims"]]
    sections = read_stored_yaml(SECTIONS_FILE)
    declared_ids = [entry["id"] for entry in declared]
    placed_ids = [claim_id for section_ids in sections.values() for claim_id in section_ids]
    for claim_id in dict.fromkeys([*declared_ids, *placed_ids]):
        if declared_ids.count(claim_id) != 1 or placed_ids.count(claim_id) != 1:
            raise InputError(
                f"ledger, claim '{claim_id}': it has to be declared once, in the {CLAIMS_FILE} "
                "of an experiment, and named once in sections.yaml"
            )
    by_id = dict(zip(declared_ids, declared, strict=True))
    return [by_id[claim_id] | {"section": name} for name, ids in sections.items() for claim_id in ids]


def claims_files() -> list[Path]:
    """The files of the experiments' claims, by the names of the experiments."""
    return sorted(SECTIONS_FILE.parents[1].glob(f"experiments/*/{CLAIMS_FILE}"))
