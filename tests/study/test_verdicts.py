"""The ledger for readers: its tables in Markdown."""

from __future__ import annotations

from pathlib import Path

import pytest
import xarray as xr
from conftest import ROOT

from unilateral.errors import StorageError
from unilateral.study.judge import claims
from unilateral.study.judge import records as stored
from unilateral.study.text import documents, verdicts


def record(**changed: object) -> dict[str, object]:
    fields = {
        "id": "4.1",
        "section": "estimates",
        "statement": "it holds",
        "where": "Lemma 4.1",
        "verdict": "holds",
    }
    numbers = {"quantity": "a number", "expected": ">= 0.9", "observed": 1.23456, "margin": 0.37}
    return {**fields, **numbers, **changed}


def test_a_table_per_section_with_a_row_per_claim() -> None:
    found = verdicts.claims_tables([record(), record(id="5.1", section="algorithm", expected="<= 2")])
    assert list(found) == ["claims-estimates", "claims-algorithm"]
    row = found["claims-estimates"].splitlines()[2]
    assert row == "| 4.1 | it holds [Lemma 4.1] | a number | 1.23 ≥ 0.9 | 37 % | holds |"
    assert "1.23 ≤ 2" in found["claims-algorithm"]


@pytest.mark.parametrize(
    ("changed", "shown"),
    [
        ({"observed": -3e-16}, "| 0 ≥ 0.9 |"),
        ({"observed": 1e9, "margin": 1e9}, "| much more ≥ 0.9 | > 1000 % |"),
        ({"margin": 0.0019}, "| 0.19 % |"),
        ({"margin": 3e-7}, "| < 0.01 % |"),
        ({"margin": -0.2, "verdict": "fails"}, "| -20 % | fails |"),
        ({"expected": "<= 0", "observed": 0.0, "margin": 0.0}, "| 0 ≤ 0 | – |"),
        ({"expected": ">= 0", "observed": 0.02, "margin": 0.02}, "| 0.02 ≥ 0 | – |"),
    ],
)
def test_numbers_that_round_off_makes_are_not_shown(changed: dict[str, object], shown: str) -> None:
    assert shown in verdicts.claims_tables([record(**changed)])["claims-estimates"]


def test_letters_and_signs_are_set_as_such() -> None:
    shown = verdicts.claims_tables(
        [record(quantity="the largest lambda_max(S) |x| <= Pi_H mu, pie", verdict="a -> b")]
    )
    assert r"the largest λ_max(S) \|x\| ≤ Π_H μ, pie" in shown["claims-estimates"]
    assert "| a → b |" in shown["claims-estimates"]


def test_every_verdict_of_the_ledger_has_a_section_of_the_paper() -> None:
    records = [record(section=claim.section, verdict=claim.verdict) for claim in claims.ledger()]
    text = (ROOT / "paper.md").read_text(encoding="utf-8")
    for name in verdicts.claims_tables(records):
        assert f"<!-- {name}: begin -->" in text


def test_the_table_of_floors() -> None:
    values = {"C1": 1.234, "C2": 0.5, "s": 1.5, "s_uncertainty": 0.01, "residual": 0.0123, "pairs": 7}
    table = xr.Dataset(
        {name: ("case", [value]) for name, value in values.items()}, coords={"case": ["natural"]}
    )
    assert (
        documents.floors_table(table).splitlines()[2]
        == "| `natural` | 1.23 | 0.5 | 1.50 ± 0.01 | 7 | 1.2 % |"
    )


@pytest.mark.parametrize("content", ["", '[{"id": "4.11", "sta', "\x00"])
def test_damaged_claims_are_refused(tmp_path: Path, content: str) -> None:
    (tmp_path / "claims.json").write_text(content)
    with pytest.raises(StorageError, match=r"claims\.json is damaged; 'snakemake -j2 -f .*' makes it anew"):
        stored.read(tmp_path / "claims.json")
    (tmp_path / "claims.json").write_text('[{"id": "4.11"}]')
    assert stored.read(tmp_path / "claims.json") == [{"id": "4.11"}]
