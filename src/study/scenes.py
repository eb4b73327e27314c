"""A scene of the configuration as objects of the library, and which of its sizes h and H are paired."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from fractions import Fraction
from itertools import accumulate
from typing import Any

from unilateral.errors import InputError, StorageError
from unilateral.formulas.exact_numbers import sign
from unilateral.formulas.formula import number, real
from unilateral.geometry import mesh, partition, polygon
from unilateral.geometry.files import read_mesh
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition
from unilateral.geometry.polygon import Polygon
from unilateral.geometry.structured import structured
from unilateral.problems import case
from unilateral.problems.case import ExactSolution
from unilateral.problems.case_certificate import certify
from unilateral.problems.catalogue import names


def domain(scene: Mapping[str, Any]) -> Polygon:
    return polygon.named(scene["polygon"])


def coarsest_mesh(scene: Mapping[str, Any]) -> Mesh:
    make = {"structured": structured, "unstructured": mesh.unstructured}[scene["mesh"]["kind"]]
    return make(domain(scene), real(scene["mesh"]["h"], "mesh.h"))


def refinements(coarsest: Mesh, levels: int) -> Iterator[Mesh]:
    """The meshes of so many levels, coarse to fine."""
    return accumulate(range(levels - 1), lambda coarse, _: mesh.refine(coarse), initial=coarsest)


def stored_mesh(path: str, scene: Mapping[str, Any]) -> Mesh:
    """The coarsest mesh from its file. Raises StorageError for one that is damaged."""
    try:
        return read_mesh(path, domain(scene))
    except InputError as error:
        raise StorageError(f"{error}; 'snakemake -j2 -f {path}' makes it anew") from None


def cases(scene: Mapping[str, Any]) -> list[ExactSolution]:
    """The scene's cases, each certified. Raises InputError unless they have one form."""
    loaded = [case.load(name, domain(scene), scene["side"]) for name in scene["cases"]]
    first = loaded[0]
    for each in loaded:
        certify(each)
        if (each.clamped_sides, each.c) != (first.clamped_sides, first.c):
            raise InputError(
                f"cases '{first.name}' and '{each.name}' differ in their clamped sides or in c; put them "
                "into different scenes"
            )
    return loaded


def is_clamped(name: str) -> bool:
    """Whether this is a case that is declared with clamped sides; the name may be that of an example, too."""
    return name in names() and "clamped" in case.declared(name)[0]


def partitions(scene: Mapping[str, Any]) -> list[Partition]:
    return [partition.uniform(domain(scene), real(H, "H")) for H in scene["H"]]


def limits(scene: Mapping[str, Any]) -> tuple[float, float]:
    """The smallest and the largest H/h."""
    given = scene["H_over_h"]
    largest = real(given["max"], "H_over_h.max") if "max" in given else math.inf
    return real(given.get("min", 0), "H_over_h.min"), largest


def normed(scene: Mapping[str, Any]) -> list[int]:
    """The numbers of the partitions on which ||lambda - lambda_H||_{-1/2} is measured.

    They are coarser than the finest mesh, since beta is 0 on others, and no coarser than `H_over_h` allows.
    """
    coarsest = number(scene["mesh"]["h"], "mesh.h")
    finest = coarsest.scaled(Fraction(1, 2 ** (scene["mesh"]["levels"] - 1)))
    given = scene["H_over_h"]
    largest = coarsest * number(given["max"], "H_over_h.max") if "max" in given else None
    sizes = [number(H, "H") for H in scene["H"]]
    small = [largest is None or sign(H - largest) <= 0 for H in sizes]
    return [k for k, H in enumerate(sizes) if small[k] and sign(H - finest) > 0]
