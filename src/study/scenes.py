"""A scene of the configuration as objects of the library, and which of its sizes h and H are paired."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from fractions import Fraction
from itertools import accumulate
from typing import Any

import numpy as np

from unilateral.errors import InputError, StorageError
from unilateral.formulas.exact_numbers import sign
from unilateral.formulas.formula import parse_number, parse_real
from unilateral.geometry import mesh, partition, polygon
from unilateral.geometry.files import read_mesh
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition
from unilateral.geometry.polygon import Polygon
from unilateral.geometry.structured import make_structured_mesh
from unilateral.problems import case
from unilateral.problems.case import ExactSolution
from unilateral.problems.case_certificate import certify_case
from unilateral.problems.catalogue import case_names


def scene_polygon(scene: Mapping[str, Any]) -> Polygon:
    """The polygon of a scene."""
    return polygon.find_polygon(scene["polygon"])


def coarsest_mesh(scene: Mapping[str, Any]) -> Mesh:
    """The coarsest mesh of a scene, structured or by gmsh."""
    make = {"structured": make_structured_mesh, "unstructured": mesh.make_unstructured_mesh}[
        scene["mesh"]["kind"]
    ]
    return make(scene_polygon(scene), parse_real(scene["mesh"]["h"], "mesh.h"))


def refine_to_levels(coarsest: Mesh, levels: int) -> Iterator[Mesh]:
    """The meshes of so many levels, coarse to fine."""
    return accumulate(range(levels - 1), lambda coarse, _: mesh.refine_uniformly(coarse), initial=coarsest)


def read_coarsest_mesh(path: str, scene: Mapping[str, Any]) -> Mesh:
    """The coarsest mesh from its file. Raises StorageError for one that is damaged."""
    try:
        return read_mesh(path, scene_polygon(scene))
    except InputError as error:
        raise StorageError(f"{error}; 'snakemake -j2 -f {path}' makes it anew") from None


def load_cases(scene: Mapping[str, Any]) -> list[ExactSolution]:
    """The scene's cases, each certified. Raises InputError unless they have one form."""
    loaded = [case.load_solution(name, scene_polygon(scene), scene["side"]) for name in scene["cases"]]
    first = loaded[0]
    for loaded_case in loaded:
        certify_case(loaded_case)
        if (loaded_case.clamped_sides, loaded_case.c) != (first.clamped_sides, first.c):
            raise InputError(
                f"cases '{first.name}' and '{loaded_case.name}' differ in their clamped sides or in c; "
                "put them into different scenes"
            )
    return loaded


def has_clamped_sides(name: str) -> bool:
    """Whether this is a case that is declared with clamped sides; the name may be that of an example, too."""
    return name in case_names() and "clamped" in case.read_case_declaration(name)[0]


def scene_partitions(scene: Mapping[str, Any]) -> list[Partition]:
    """The uniform partitions of a scene, coarse to fine."""
    return [partition.make_uniform_partition(scene_polygon(scene), parse_real(H, "H")) for H in scene["H"]]


def find_partition_of_ratio(mesh: Mesh, partitions: Sequence[Partition], H_over_h: float) -> int:
    """The number of the partition whose H/h is nearest to the one asked for."""
    return int(np.argmin([abs(partition.H / mesh.h - H_over_h) for partition in partitions]))


def H_over_h_limits(scene: Mapping[str, Any]) -> tuple[float, float]:
    """The smallest and the largest H/h."""
    limits = scene["H_over_h"]
    largest = parse_real(limits["max"], "H_over_h.max") if "max" in limits else math.inf
    return parse_real(limits.get("min", 0), "H_over_h.min"), largest


def dual_norm_partitions(scene: Mapping[str, Any]) -> list[int]:
    """The numbers of the partitions on which ||lambda - lambda_H||_{-1/2} is measured.

    They are coarser than the finest mesh, since beta is 0 on others, and no coarser than `H_over_h` allows.
    """
    coarsest = parse_number(scene["mesh"]["h"], "mesh.h")
    # Exact numbers, for H = h has to be told from H > h
    finest = coarsest.scale(Fraction(1, 2 ** (scene["mesh"]["levels"] - 1)))
    limits = scene["H_over_h"]
    largest = coarsest * parse_number(limits["max"], "H_over_h.max") if "max" in limits else None
    sizes = [parse_number(H, "H") for H in scene["H"]]
    small = [largest is None or sign(H - largest) <= 0 for H in sizes]
    return [k for k, H in enumerate(sizes) if small[k] and sign(H - finest) > 0]
