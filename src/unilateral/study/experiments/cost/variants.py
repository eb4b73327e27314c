"""The configurations of the study of cost: a base, one field of it varied at a time, some pairs crossed."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from typing import Any, NamedTuple

from unilateral.formulas.formula import real

REFRESH = 50
"""The refined way makes one of so many products in double precision."""


class Variant(NamedTuple):
    """One configuration. `algebra` is the matrix that a step solves with (A, A_3) or multiplies by (S)."""

    scene: str
    case: str
    H_over_h: float
    algorithm: str
    algebra: str
    precision: str


def plan(study: Mapping[str, Any]) -> list[Variant]:
    """The base, each of its fields varied alone, and some of them crossed; each once, in that order."""

    def variant(changed: Mapping[str, Any]) -> Variant:
        fields = study["base"] | changed
        return Variant(**fields | {"H_over_h": real(fields["H_over_h"], "cost.H_over_h")})

    vary = study["vary"]
    alone = [{name: value} for name, values in vary.items() for value in values]
    together = [
        dict(zip(names, values, strict=True))
        for names in study["cross"]
        for values in itertools.product(*([study["base"][name], *vary[name]] for name in names))
    ]
    return list(dict.fromkeys(variant(changed) for changed in [{}, *alone, *together]))
