"""Meshes of commands: those in files that --mesh names, and those of a size that --h gives."""

from __future__ import annotations

import warnings
from pathlib import Path

from unilateral import api
from unilateral.discrete.choice import check_mesh_memory
from unilateral.errors import InputError, SolutionWarning
from unilateral.geometry.files import read_mesh
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.polygon import Polygon
from unilateral.geometry.structured import default_mesh_kind


def read_mesh_option(
    file: str, polygon: Polygon | None, option: str = "--mesh", corners: bool = False
) -> Mesh:
    """The mesh in the file, by `read_mesh`. Warnings say what was changed in it."""
    if not Path(file).is_file():
        raise InputError(f"argument {option}: there is no file '{file}'")
    with warnings.catch_warnings():
        warnings.simplefilter("always", SolutionWarning)
        return read_mesh(file, polygon, corners)


def make_mesh_of_size(polygon: Polygon, h: float) -> Mesh:
    """A mesh of the polygon, structured where its sides allow that. Raises InputError for too small an h."""
    check_mesh_memory(polygon, h)
    return api.MESH_KINDS[default_mesh_kind(polygon)](polygon, h)
