"""A scene of the configuration as objects of the library."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import accumulate
from typing import Any

from unilateral.errors import InputError, StorageError
from unilateral.formulas.formula import real
from unilateral.geometry import mesh, partition, polygon
from unilateral.geometry.files import read_mesh
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition
from unilateral.geometry.polygon import Polygon
from unilateral.geometry.structured import structured
from unilateral.problems import case
from unilateral.problems.case import Case
from unilateral.problems.case_certificate import certify


def domain(scene: Mapping[str, Any]) -> Polygon:
    return polygon.named(scene["polygon"])


def coarsest_mesh(scene: Mapping[str, Any]) -> Mesh:
    make = {"structured": structured, "unstructured": mesh.unstructured}[scene["mesh"]["kind"]]
    return make(domain(scene), real(scene["mesh"]["h"], "mesh.h"))


def refinements(coarsest: Mesh, levels: int) -> Iterator[Mesh]:
    """The meshes of so many levels, coarse to fine."""
    return accumulate(range(levels - 1), lambda found, _: mesh.refine(found), initial=coarsest)


def stored_mesh(path: str, scene: Mapping[str, Any]) -> Mesh:
    """The coarsest mesh from its file. Raises StorageError for one that is damaged."""
    try:
        return read_mesh(path, domain(scene))
    except InputError as error:
        raise StorageError(f"{error}; 'snakemake -j2 -f {path}' makes it anew") from None


def cases(scene: Mapping[str, Any]) -> list[Case]:
    """The scene's cases, each certified."""
    found = [case.load(name, domain(scene), scene["side"]) for name in scene["cases"]]
    for each in found:
        certify(each)
    return found


def partitions(scene: Mapping[str, Any]) -> list[Partition]:
    return [partition.uniform(domain(scene), real(H, "H")) for H in scene["H"]]
