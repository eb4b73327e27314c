"""What the ledger declares of every claim, in a file for each section."""

from __future__ import annotations

from importlib import resources
from typing import Any

from unilateral.system.declarations import own

FILES = (
    "formulation.yaml",
    "stability.yaml",
    "estimates.yaml",
    "theorems.yaml",
    "algorithm.yaml",
    "cost.yaml",
    "beyond.yaml",
    "adaptive.yaml",
    "extremes.yaml",
)
"""In the order of the paper."""


def entries() -> list[dict[str, Any]]:
    """The claims as they are declared, section by section."""
    folder = resources.files("unilateral.study.ledger")
    return [entry for name in FILES for entry in own(folder / name)["claims"]]
