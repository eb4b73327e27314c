"""Memory and time of a job, from measured jobs of its rule: see workflow/config/resources.yaml."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from unilateral.formulas.formula import real
from unilateral.geometry import polygon
from unilateral.study.sizes import normed

Fields = Mapping[str, Any]
ROUND = 50
"""The memory that is asked for is a multiple of so many MB."""


def mem_mb(study: Fields, rule: str, wildcards: Mapping[str, str], attempt: int = 1) -> int:
    """The memory that a job asks for, in MB; each further attempt asks for that much more."""
    return attempt * ROUND * math.ceil(_asked(study, rule, wildcards, "mb") / ROUND)


def runtime(study: Fields, rule: str, wildcards: Mapping[str, str], attempt: int = 1) -> int:
    """The time that a job asks for, in minutes; each further attempt asks for that much more."""
    return attempt * math.ceil(_asked(study, rule, wildcards, "seconds") / 60)


def _asked(study: Fields, rule: str, wildcards: Mapping[str, str], unit: str) -> float:
    given = study["resources"]
    taken = predicted(study, rule, wildcards, unit)
    return float(given["snakemake"][unit] + given["margin"][unit] * taken)


def predicted(study: Fields, rule: str, wildcards: Mapping[str, str], unit: str) -> float:
    """The `mb` or `seconds` of a job of the size n: start + (measured - start) (n / measured size)^growth.

    The measured job is the largest that is no larger than n or, if there is none, the smallest one.
    """
    start, of_rule = study["resources"]["start"][unit], study["resources"]["rules"][rule]
    n = size(study, rule, wildcards)
    jobs = sorted(of_rule["measured"], key=lambda job: float(job["size"]))
    job = ([job for job in jobs if job["size"] <= n] or jobs[:1])[-1]
    return float(start + (job[unit] - start) * (n / job["size"]) ** of_rule["growth"][unit])


def size(study: Fields, rule: str, wildcards: Mapping[str, str]) -> int:
    """What the memory and the time of a job of the rule grow with; 1 where all its jobs are alike."""
    return round(SIZES[rule](study, wildcards)) if rule in SIZES else 1


def _cells(study: Fields, wildcards: Mapping[str, str]) -> float:
    """The number of cells of the finest partition on which lambda has a norm."""
    scene = study["scenes"][wildcards["scene"]]
    finest = min(real(scene["H"][k], "H") for k in normed(scene))
    return polygon.named(scene["polygon"]).perimeter / finest


def _unknowns(domain: str, given: Sequence[Any]) -> float:
    """|Omega| / h^2 for the smallest of these h on the polygon of that name, taken for the unknowns."""
    return polygon.named(domain).area / min(real(h, "h") for h in given) ** 2


def _of_levels(scene: Fields, levels: int) -> float:
    """The unknowns of the finest of so many levels."""
    return _unknowns(scene["polygon"], [scene["mesh"]["h"]]) * 4 ** (levels - 1)


def _of_solve(study: Fields, wildcards: Mapping[str, str]) -> float:
    scene = study["scenes"][wildcards["scene"]]
    return _of_levels(scene, scene["mesh"]["levels"])


def _of_totals(study: Fields, wildcards: Mapping[str, str]) -> float:
    return _of_levels(study["scenes"][wildcards["scene"]], study["totals"]["levels"])


def _of_cost(study: Fields, wildcards: Mapping[str, str]) -> float:
    job = study["cost"]["jobs"][int(wildcards["job"])]
    return _unknowns(study["scenes"][job["scene"]]["polygon"], job["h"])


def _of_sharpness(study: Fields, wildcards: Mapping[str, str]) -> float:
    given = study["sharpness"]
    return _unknowns(given["polygon"], given["H"]) / real(given["h_over_H"], "h_over_H") ** 2


def _of_algorithm(study: Fields, wildcards: Mapping[str, str]) -> float:
    return _unknowns(study["algorithm"]["polygon"], study["algorithm"]["eliminated"])


def _of_adaptive(study: Fields, wildcards: Mapping[str, str]) -> float:
    return float(study["adaptive"]["most"]["unknowns"])


def _of_deep(study: Fields, wildcards: Mapping[str, str]) -> float:
    return _unknowns(study["deep"]["polygon"], [study["deep"]["h"][int(wildcards["level"])]])


SIZES: dict[str, Callable[[Fields, Mapping[str, str]], float]] = {
    "adaptive": _of_adaptive,
    "algorithm": _of_algorithm,
    "cost_runs": _of_cost,
    "deep_level": _of_deep,
    "dual_norm": _cells,
    "sharpness": _of_sharpness,
    "solve": _of_solve,
    "totals": _of_totals,
}
"""The size of a job, by the rules whose jobs differ: the unknowns of its largest mesh, or its cells."""
