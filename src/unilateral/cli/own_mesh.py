"""The mesh in a file that --mesh names."""

from __future__ import annotations

import warnings
from pathlib import Path

from unilateral.errors import InputError, SolutionWarning
from unilateral.geometry.files import read_mesh
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.polygon import Polygon


def own_mesh(file: str, polygon: Polygon | None, option: str = "--mesh", corners: bool = False) -> Mesh:
    """The mesh in the file, by `read_mesh`. Warnings say what was changed in it."""
    if not Path(file).is_file():
        raise InputError(f"argument {option}: there is no file '{file}'")
    with warnings.catch_warnings():
        warnings.simplefilter("always", SolutionWarning)
        return read_mesh(file, polygon, corners)
