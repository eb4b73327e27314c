"""The names of the cases that come with the program."""

from __future__ import annotations

from importlib import resources
from importlib.resources.abc import Traversable


def catalogue_folder() -> Traversable:
    """The folder of their YAML files."""
    return resources.files("unilateral.manufactured")


def case_names() -> list[str]:
    """The names in alphabetical order."""
    return sorted(entry.name[:-5] for entry in catalogue_folder().iterdir() if entry.name.endswith(".yaml"))
