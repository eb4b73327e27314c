"""The ledger for readers: its tables in Markdown."""

import pytest
from conftest import ROOT

from unilateral.errors import StorageError
from unilateral.study.documents import verdicts
from unilateral.study.ledger import claims
from unilateral.study.ledger import records as stored


def record(**changed):
    fields = {
        "id": "4.1",
        "section": "estimates",
        "statement": "it holds",
        "where": "Lemma 4.1",
        "verdict": "holds",
    }
    numbers = {
        "quantity": "a number",
        "expected": ">= 0.9",
        "observed": 1.23456,
        "margin": 0.37,
        "sees": "× 1.03",
    }
    return {**fields, **numbers, **changed}


def row(**changed):
    """The one row of the table of one record."""
    return verdicts.claims_tables([record(**changed)])["claims-estimates"].iloc[0].tolist()


def test_a_table_per_section_with_a_row_per_claim():
    found = verdicts.claims_tables([record(), record(id="5.1", section="algorithm", expected="<= 2")])
    assert list(found) == ["claims-estimates", "claims-algorithm"]
    assert row() == ["4.1", "it holds [Lemma 4.1]", "a number", "1.23 ≥ 0.9", "37 %", "× 1.03", "holds"]
    assert found["claims-algorithm"]["observed"].tolist() == ["1.23 ≤ 2"]


def test_a_claim_holds_unless_it_fails():
    records = [record(), record(id="1.8", verdict="is an error"), record(id="9", verdict="fails")]
    records.append(record(id="10", verdict="not judged: nothing is known"))
    records.append(record(id="11", verdict="nothing to measure: it is a definition"))
    assert verdicts.holding(records) == {"4.1": True, "1.8": True, "9": False, "10": False, "11": False}


@pytest.mark.parametrize(
    ("changed", "shown"),
    [
        ({"observed": -3e-16}, "0 ≥ 0.9"),
        ({"observed": 1e9, "margin": 1e9}, "much more ≥ 0.9 | > 1000 %"),
        ({"margin": 0.0019}, "0.19 %"),
        ({"margin": 3e-7}, "< 0.01 %"),
        ({"margin": -0.2, "verdict": "fails", "sees": None}, "-20 % | – | fails"),
        ({"expected": "<= 0", "observed": 0.0, "margin": 0.0}, "0 ≤ 0 | –"),
        ({"expected": ">= 0", "observed": 0.02, "margin": 0.02}, "0.02 ≥ 0 | –"),
    ],
)
def test_numbers_that_round_off_makes_are_not_shown(changed, shown):
    assert f"| {shown} |" in f"| {' | '.join(row(**changed))} |"


def test_of_what_is_not_judged_the_reason_is_shown_and_no_number():
    numbers = dict.fromkeys(("quantity", "expected", "observed", "margin", "sees"))
    shown = row(**numbers, verdict="not judged: beta is not known of square")
    assert shown[2:] == ["–", "–", "–", "–", "not judged: β is not known of square"]


@pytest.mark.parametrize(
    ("sees", "shown"),
    [
        ("below 0.0001 % of the control", "< 0.0001 %"),
        ("3 % of the control", "3 %"),
        ("all of the control", "all"),
        ("below × 1.0000001", "< × 1.0000001"),
        (None, "–"),
    ],
)
def test_what_a_claim_sees_is_short(sees, shown):
    assert row(sees=sees)[-2] == shown


def test_letters_and_signs_are_set_as_such():
    shown = row(quantity="the largest lambda_max(S) |x| <= Pi_H mu, pie", verdict="a -> b")
    assert shown[2] == r"the largest λ_max(S) \|x\| ≤ Π_H μ, pie"
    assert shown[-1] == "a → b"


def test_every_verdict_of_the_ledger_has_a_table_in_the_supplement():
    records = [record(section=claim.section, verdict=claim.verdict) for claim in claims.ledger()]
    text = (ROOT / "supplement.md").read_text(encoding="utf-8")
    for name in verdicts.claims_tables(records):
        assert f"<!-- {name}: begin -->" in text


@pytest.mark.parametrize("content", ["", '[{"id": "4.11", "sta', "\x00"])
def test_damaged_claims_are_refused(tmp_path, content):
    (tmp_path / "claims.json").write_text(content)
    with pytest.raises(StorageError, match=r"claims\.json is damaged; 'snakemake -j2 -f .*' makes it anew"):
        stored.read(tmp_path / "claims.json")
    (tmp_path / "claims.json").write_text('[{"id": "4.11"}]')
    assert stored.read(tmp_path / "claims.json") == [{"id": "4.11"}]
