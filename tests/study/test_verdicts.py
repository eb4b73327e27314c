"""The ledger for readers: its tables in Markdown, the rows of its figure, and the figure."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest
from conftest import ROOT, texts
from matplotlib.figure import Figure
from matplotlib.transforms import Bbox

from unilateral.errors import InputError, StorageError
from unilateral.study import figures as plots
from unilateral.study import tables
from unilateral.study.judge import claims
from unilateral.study.text import verdicts


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


def row(**changed: object) -> list[str]:
    """The one row of the table of one record."""
    return verdicts.claims_tables([record(**changed)])["claims-estimates"].iloc[0].tolist()


def test_a_table_per_section_with_a_row_per_claim() -> None:
    found = verdicts.claims_tables([record(), record(id="5.1", section="algorithm", expected="<= 2")])
    assert list(found) == ["claims-estimates", "claims-algorithm"]
    assert row() == ["4.1", "it holds [Lemma 4.1]", "a number", "1.23 ≥ 0.9", "37 %", "holds"]
    assert found["claims-algorithm"]["observed"].tolist() == ["1.23 ≤ 2"]


def test_a_claim_holds_unless_it_fails() -> None:
    records = [record(), record(id="1.8", verdict="is an error"), record(id="9", verdict="fails")]
    assert verdicts.holding(records) == {"4.1": True, "1.8": True, "9": False}


@pytest.mark.parametrize(
    ("changed", "shown"),
    [
        ({"observed": -3e-16}, "0 ≥ 0.9"),
        ({"observed": 1e9, "margin": 1e9}, "much more ≥ 0.9 | > 1000 %"),
        ({"margin": 0.0019}, "0.19 %"),
        ({"margin": 3e-7}, "< 0.01 %"),
        ({"margin": -0.2, "verdict": "fails"}, "-20 % | fails"),
        ({"expected": "<= 0", "observed": 0.0, "margin": 0.0}, "0 ≤ 0 | –"),
        ({"expected": ">= 0", "observed": 0.02, "margin": 0.02}, "0.02 ≥ 0 | –"),
    ],
)
def test_numbers_that_round_off_makes_are_not_shown(changed: dict[str, object], shown: str) -> None:
    assert f"| {shown} |" in f"| {' | '.join(row(**changed))} |"


def test_letters_and_signs_are_set_as_such() -> None:
    shown = row(quantity="the largest lambda_max(S) |x| <= Pi_H mu, pie", verdict="a -> b")
    assert shown[2] == r"the largest λ_max(S) \|x\| ≤ Π_H μ, pie"
    assert shown[-1] == "a → b"


@pytest.mark.parametrize(
    ("verdict", "kind"),
    [
        ("holds", "holds"),
        ("holds and is sharp", "holds, and is sharp"),
        ("holds; not sharp but as alpha -> 0", "holds"),
        ("holds; the rate is larger, so sharp as alpha -> 0", "holds, and is sharp"),
        ("needs h/H small", "needs a condition that is left out"),
        ("is an error of the source", "is an error of the source"),
        ("is supported by every run", "supported beyond the paper"),
        ("fails", "fails"),
    ],
)
def test_the_kinds_of_verdicts(verdict: str, kind: str) -> None:
    assert verdicts.verdict_frame([record(verdict=verdict)])["kind"].tolist() == [kind]


def test_margins_end_where_the_axis_does() -> None:
    found = verdicts.verdict_frame([record(margin=m) for m in (1e-9, 0.5, 1e9)])
    assert found["margin"].tolist() == [1e-4, 0.5, 10.0]


def test_every_verdict_of_the_ledger_has_a_kind_and_a_section_of_the_paper() -> None:
    records = [record(section=claim.section, verdict=claim.verdict) for claim in claims.ledger()]
    assert "fails" not in set(verdicts.verdict_frame(records)["kind"])
    text = (ROOT / "paper.md").read_text(encoding="utf-8")
    for name in verdicts.claims_tables(records):
        assert f"<!-- {name}: begin -->" in text


def test_the_figure_shows_every_claim(tmp_path: Path, drawn: list[tuple[Figure, Bbox]]) -> None:
    table = verdicts.verdict_frame([record(id=f"4.{k}", margin=0.1 * k) for k in range(1, 6)])
    tables.save_csv(table, tmp_path / "verdict.csv")
    plots.verdict(tmp_path / "verdict.csv", tmp_path / "verdict.svg")
    figure, seen = drawn[0]
    shown = [float(line.get_xdata()[0]) for axes in figure.axes for line in axes.lines]
    assert shown == pytest.approx([0.1, 0.2, 0.3, 0.4, 0.5])
    named = [[label.get_text() for label in axes.get_yticklabels()] for axes in figure.axes]
    assert named == [["4.1", "4.2", "4.3"], ["4.4", "4.5"]]
    heights = [[float(line.get_ydata()[0]) for line in axes.lines] for axes in figure.axes]
    assert heights == [[2, 1, 0], [2, 1]]
    assert min(text.get_fontsize() for text in texts(figure)) >= 8
    assert seen.x0 >= -0.01
    assert seen.y0 >= -0.01
    assert seen.x1 <= figure.get_figwidth() + 0.01
    assert seen.y1 <= figure.get_figheight() + 0.01


def test_an_unknown_kind_is_refused(tmp_path: Path) -> None:
    pd.DataFrame({"label": ["4.1"], "kind": ["perhaps"], "margin": [0.1]}).to_csv(tmp_path / "verdict.csv")
    with pytest.raises(InputError, match="'perhaps' is none of holds,"):
        plots.verdict(tmp_path / "verdict.csv", tmp_path / "verdict.svg")
    assert not (tmp_path / "verdict.svg").exists()


@pytest.mark.parametrize("content", ["", '[{"id": "4.11", "sta', "\x00"])
def test_damaged_claims_are_refused(tmp_path: Path, content: str) -> None:
    (tmp_path / "claims.json").write_text(content)
    with pytest.raises(StorageError, match=r"claims\.json is damaged; 'snakemake -j2 -f .*' makes it anew"):
        verdicts.read(tmp_path / "claims.json")
    (tmp_path / "claims.json").write_text('[{"id": "4.11"}]')
    assert verdicts.read(tmp_path / "claims.json") == [{"id": "4.11"}]
