"""The ledger: every statement of the paper, a check on the study's results, and a verdict.

The statements are declared in `ledger.yaml`; `checks` holds what is measured. A check gives an observed
number and the one it has to reach or to stay below; its margin is what is left, relative to the latter. A
claim whose margin is not negative gets the verdict that the ledger declares for that case, any other one
fails. A control is a spoilt result on which the check has to fail.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any

import xarray as xr
import yaml

from unilateral.errors import InputError
from unilateral.study.judge.checks import algorithm, cost, estimates, extremes, stability
from unilateral.study.judge.checks.found import Found, Tables
from unilateral.study.tables import load

FAILS = "fails"
LETTERS = {
    r"\frac12": "1/2 ", r"\partial ": "∂", r"\lambda": "λ", r"\mu": "μ", r"\beta": "β", r"\rho": "ρ",
    r"\sigma": "σ", r"\alpha": "α", r"\varepsilon": "ε", r"\Pi": "Π", r"\langle": "<", r"\rangle": ">",
    r"\|": "‖", r"\le ": "<= ", r"\ge ": ">= ", r"\sim": "~", r"\inf": "inf", r"\in ": "in ",
    r"\sup": "sup", r"\coth": "coth ", r"\max": "max", r"\min": "min", r"\log": "log", r"\gamma": "γ",
    r"\Omega": "Ω", r"\Lambda": "Λ", r"\times": "×", r"\cdot": "·", r"\,": " ", "$": "",
}  # fmt: skip
CHECKS = {
    "algorithm": algorithm,
    "cost": cost,
    "estimates": estimates,
    "extremes": extremes,
    "stability": stability,
}


class Results(dict[str, xr.Dataset]):
    """The tables below a folder by name, such as "square/errors", read when they are asked for."""

    def __init__(self, folder: str | Path, tables: Mapping[str, xr.Dataset] | None = None) -> None:
        super().__init__(tables or {})
        self.folder = Path(folder)

    def __missing__(self, name: str) -> xr.Dataset:
        self[name] = load(self.folder / f"{name}.nc")
        return self[name]


@dataclass(frozen=True)
class Claim:
    """A statement: where it stands, what the study says if the check passes, and how it is checked.

    `section` is where this study reports it; `reads` names the tables it depends on; `control` spoils one.
    """

    id: str
    section: str
    statement: str
    where: str
    verdict: str
    check: str
    parameters: Mapping[str, Any]
    reads: tuple[str, ...]
    source: str
    control: Mapping[str, Any]

    def measure(self, results: Tables) -> Found:
        """The check's finding. Raises InputError for a table that is missing."""
        module, function = self.check.split(".")
        found: Found = getattr(CHECKS[module], function)(results, **self.parameters)
        return found


@dataclass(frozen=True)
class Judgement:
    """A claim with what was found."""

    claim: Claim
    found: Found

    @property
    def holds(self) -> bool:
        return self.margin >= 0

    @property
    def margin(self) -> float:
        """NaN, which is no pass, where the observed number is."""
        slack = self.found.observed - self.found.required
        slack = (slack if self.found.at_least else -slack) + 0.0
        return slack / abs(self.found.required) if self.found.required else slack

    @property
    def verdict(self) -> str:
        return self.claim.verdict if self.holds else FAILS

    def record(self) -> dict[str, Any]:
        """What `results/claims.json` holds of a claim."""
        found, claim = self.found, self.claim
        sign = ">=" if found.at_least else "<="
        return {
            "id": claim.id,
            "section": claim.section,
            "statement": claim.statement,
            "where": claim.where,
            "scene": sorted({name.split("/")[0] for name in claim.reads}),
            "quantity": found.quantity,
            "expected": f"{sign} {found.required:.4g}",
            "source": claim.source,
            "observed": float(f"{found.observed:.4g}"),
            "margin": float(f"{self.margin:.2g}"),
            "verdict": self.verdict,
            "control": claim.control["what"],
        }


@cache
def ledger() -> tuple[Claim, ...]:
    """All claims, in the order of the paper."""
    text = (resources.files("unilateral.study.judge") / "ledger.yaml").read_text(encoding="utf-8")
    found = []
    for entry in yaml.safe_load(text)["claims"]:
        parameters = entry.get("parameters", {})
        scenes = parameters.get("scenes", [""])
        reads = [name.format(scene=scene) for name in entry["reads"] for scene in scenes]
        fields = entry | {"parameters": parameters, "reads": tuple(dict.fromkeys(reads))}
        found.append(Claim(**fields))
    return tuple(found)


def judge(results: Tables, claims: Iterable[Claim] | None = None) -> list[Judgement]:
    """The claims' judgements by those tables."""
    return [Judgement(claim, claim.measure(results)) for claim in claims or ledger()]


def spoilt(results: Results, control: Mapping[str, Any]) -> Results:
    """The results with some tables changed, as a control says.

    `tables` names them. They are replaced `by` another table; or their `variable` is multiplied by a
    `factor`, put to a `value` everywhere or `at` the positions given by dimension, replaced `from` another
    variable, or `to` some labels from other `labels`.
    """
    changed = Results(results.folder, results)
    for name in control["tables"]:
        table = (results[control["by"]] if "by" in control else results[name]).copy(deep=True)
        if "variable" in control:
            _spoil(table, control)
        changed[name] = table
    return changed


def _spoil(table: xr.Dataset, control: Mapping[str, Any]) -> None:
    here = table[control["variable"]]
    place = {d: i for d, i in control.get("at", {}).items() if d in here.dims}
    if "labels" in control:
        here.loc[control["to"]] = here.sel(control["labels"]).values
    elif "from" in control:
        here[:] = table[control["from"]].values
    else:
        here[place] = control["value"] if "value" in control else here[place] * control["factor"]


def find(wanted: str) -> Claim:
    """The claim with that id. Raises InputError, with the ids there are."""
    for claim in ledger():
        if claim.id == wanted:
            return claim
    known = ", ".join(claim.id for claim in ledger())
    raise InputError(f"there is no claim '{wanted}'; the ledger has {known}")


def plain(text: str) -> str:
    """A statement for the terminal: TeX's commands as letters, and its groups in parentheses."""
    for command, letter in LETTERS.items():
        text = text.replace(command, letter)
    return re.sub(r"\{(.)\}", r"\1", text).replace("{", "(").replace("}", ")")


def summary(judgements: Iterable[Judgement]) -> str:
    """A line per claim: id, observed against required, margin, verdict."""
    lines = [f"{'claim':9} {'observed':>10}    {'required':>10} {'margin':>8}  verdict"]
    for each in judgements:
        found = each.found
        sign = ">=" if found.at_least else "<="
        numbers = f"{found.observed:10.4g} {sign} {found.required:10.4g} {_percent(each):>8}"
        lines.append(f"{each.claim.id:9} {numbers}  {each.verdict}")
    return "\n".join(lines)


def _percent(judgement: Judgement) -> str:
    """The margin; nothing is relative to a requirement of 0."""
    known = math.isfinite(judgement.margin) and judgement.found.required != 0
    return f"{100 * judgement.margin:.3g} %" if known else "none"


def explanation(judgement: Judgement) -> str:
    """Everything about one claim, with its numbers."""
    claim, found = judgement.claim, judgement.found
    sign = "at least" if found.at_least else "at most"
    lines = [
        f"{claim.id}: {plain(claim.statement)}",
        f"where: {claim.where}",
        f"check: {found.quantity} has to be {sign} {found.required:.4g} ({claim.source})",
        f"observed: {found.observed:.4g}, margin {_percent(judgement)}",
        f"verdict: {judgement.verdict}",
        f"control: {claim.control['what']}",
        f"tables: {', '.join(claim.reads)}",
        *found.lines,
    ]
    return "\n".join(lines)
