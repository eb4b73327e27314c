"""What documents report on: the study's tables, its claims and its parameters."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import pandas as pd
import xarray as xr

from unilateral.formulas.formula import real
from unilateral.study import tables
from unilateral.study.ledger import records
from unilateral.system.files import replacing

TABLES = (
    "algorithm",
    "case",
    "scene",
    "algebra",
    "precision",
    "floors",
    "sharpness",
    "cells",
    "alternating",
    "adapted",
    "adapted_rates",
    "adapted_beta",
    "extremes",
    "benchmarks",
)


class Sources(NamedTuple):
    """`rates` and `totals` are by scene, `tables` by name; `pairs` is the table behind the figure of beta.

    `scores` holds the scores of other solvers' solutions, `commands` what processes take, and `whole` what an
    installation and the whole study take.
    """

    tables: Mapping[str, xr.Dataset]
    rates: Mapping[str, xr.Dataset]
    totals: Mapping[str, xr.Dataset]
    pairs: pd.DataFrame
    scores: pd.DataFrame
    claims: Sequence[Mapping[str, Any]]
    study: Mapping[str, Any]
    commands: Mapping[str, Any]
    whole: Mapping[str, Any]

    @property
    def H_over_h(self) -> float:
        """H/h of the runs that the study of cost recommends."""
        return real(self.study["cost"]["base"]["H_over_h"], "H_over_h")

    @property
    def coarsest(self) -> float:
        """The largest H of the fits in the study of cost."""
        return real(self.study["cost"]["fitted_from"], "fitted_from")


def read(paths: Mapping[str, Any], study: Mapping[str, Any]) -> Sources:
    """The sources from files by name; those of `rates` and `totals` are in the order of the scenes."""
    rates, totals = (
        {scene: tables.load(path) for scene, path in zip(study[scenes], paths[what], strict=True)}
        for what, scenes in (("rates", "judged"), ("totals", "bounded"))
    )
    of = {name: tables.load(paths[name]) for name in TABLES}
    pairs, scores = (pd.read_csv(paths[name]) for name in ("pairs", "scores"))
    claims, commands, whole = (records.read(paths[name]) for name in ("claims", "commands", "whole"))
    return Sources(of, rates, totals, pairs, scores, claims, study, commands, whole)


def write(values: Mapping[str, Any], path: str | os.PathLike[str]) -> None:
    """Write the values as JSON, one on each line."""
    with replacing(path) as temporary:
        temporary.write_text(json.dumps(values, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
