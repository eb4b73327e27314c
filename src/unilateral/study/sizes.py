"""The sizes h and H of a scene of the configuration: which pairs are solved, and where lambda has a norm."""

from __future__ import annotations

import math
from collections.abc import Mapping
from fractions import Fraction
from typing import Any

from unilateral.formulas.exact_numbers import sign
from unilateral.formulas.formula import number, real


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
