"""The ledger for readers: its tables in Markdown."""

import re

import pytest
import sentences
from conftest import RESULTS, ROOT

from study.documents import verdicts
from study.ledger import claims, texts
from study.ledger import records as stored
from unilateral.errors import StorageError


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
        "source": "derived: it is so",
    }
    return {**fields, **numbers, **changed}


def row(**changed):
    """The one row of the table of one record."""
    return verdicts.tabulate_claims([record(**changed)])["claims-estimates"].iloc[0].tolist()


def test_a_table_per_section_with_a_row_per_claim():
    claims = verdicts.tabulate_claims([record(), record(id="5.1", section="algorithm", expected="<= 2")])
    assert list(claims) == ["claims-estimates", "claims-algorithm"]
    measured = "a number: $1.23 \\ge 0.9$; margin 37\u00a0%; sees ×\u00a01.03"
    assert row() == ["4.1", "it holds [Lemma 4.1]", measured, "holds"]
    assert r": $1.23 \le 2$; " in claims["claims-algorithm"]["measured"].item()


def test_a_claim_holds_unless_it_fails():
    records = [record(), record(id="1.8", verdict="is an error"), record(id="9", verdict="fails")]
    records.append(record(id="10", verdict="not judged: nothing is known"))
    records.append(record(id="11", verdict="nothing to measure: it is a definition"))
    assert verdicts.holds_by_claim(records) == {
        "4.1": True,
        "1.8": True,
        "9": False,
        "10": False,
        "11": False,
    }


@pytest.mark.parametrize(
    ("changed", "displayed"),
    [
        ({"observed": -3e-16}, "$0 \\ge 0.9$; margin 37 %; sees × 1.03"),
        ({"observed": 1e9, "margin": 1e9}, "$\\text{much more} \\ge 0.9$; margin > 1000 %; sees × 1.03"),
        ({"margin": 0.0019}, "$1.23 \\ge 0.9$; margin 0.19 %; sees × 1.03"),
        ({"margin": 3e-7}, "$1.23 \\ge 0.9$; margin < 0.01 %; sees × 1.03"),
        ({"margin": -0.2, "verdict": "fails", "sees": None}, "$1.23 \\ge 0.9$; margin -20 %"),
        ({"expected": "<= 0", "observed": 0.0, "margin": 0.0}, "$0 \\le 0$; sees × 1.03"),
        ({"expected": ">= 0", "observed": 0.02, "margin": 0.02}, "$0.02 \\ge 0$; sees × 1.03"),
        (
            {"expected": ">= -1e-06", "observed": -5.12e-08},
            "$-5.12\\cdot 10^{-8} \\ge -10^{-6}$; margin 37 %; sees × 1.03",
        ),
    ],
)
def test_numbers_are_typeset_and_what_round_off_makes_is_not_shown(changed, displayed):
    assert row(**changed)[2] == f"a number: {displayed}".replace(" %", "\u00a0%").replace("× ", "×\u00a0")


def test_a_required_number_that_was_set_after_values_had_been_seen_has_a_dagger():
    """Control: those that were set before have none."""
    assert row(source="set after values had been seen: a round number")[2].startswith(
        "a number: $1.23 \\ge 0.9$ †; margin"
    )
    assert "†" not in row(source="set before values were known: a round number")[2]


def test_no_formula_has_a_bar_which_would_end_a_cell():
    """Bars outside of formulas are no matter of ours. Control: the formula stays one."""
    statement = row(statement=r"$|A(U,V)| \le M\,\|U\|$")[1]
    assert statement == r"$\vert A(U,V)\vert  \le M\,\Vert U\Vert $ [Lemma 4.1]"


def test_of_what_is_not_judged_the_reason_is_shown_and_no_number():
    numbers = dict.fromkeys(("quantity", "expected", "observed", "margin", "sees"))
    displayed = row(**numbers, verdict="not judged: $\\beta$ is not known of square")
    assert displayed[2:] == ["–", "not judged: $\\beta$ is not known of square"]


@pytest.mark.parametrize(
    ("sees", "displayed"),
    [
        ("below 0.0001 % of the control", "; sees below 0.0001 %"),
        ("3 % of the control", "; sees 3 %"),
        ("all of the control", "; sees all"),
        ("below × 1.0000001", "; sees below × 1.0000001"),
        (None, ""),
    ],
)
def test_what_a_claim_sees_is_short(sees, displayed):
    measured = row(sees=sees)[2].replace("\u00a0", " ")
    assert measured == rf"a number: $1.23 \ge 0.9$; margin 37 %{displayed}"


def test_names_of_letters_and_signs_are_told_as_such():
    displayed = texts.replace_greek("the largest lambda_max(S) <= Pi_H mu, pie, a -> b >= 0")
    assert displayed == "the largest λ_max(S) ≤ Π_H μ, pie, a → b ≥ 0"


def test_no_text_of_a_claim_has_mathematics_that_is_not_typeset():
    """On the page of all claims. Control: some have formulas."""
    texts = [text for claim in claims.load_ledger() for text in (claim.statement, claim.where, claim.verdict)]
    texts += [record["quantity"] or "" for record in stored.read_records(RESULTS / "claims.json")]
    outside = [re.sub(r"\$.*?\$", "", text) for text in texts]
    assert outside != texts
    assert [
        text for text in outside if re.search(r"[_^<>|\\]|\b(alpha|beta|lambda|rho|mu|delta)\b", text)
    ] == []


def test_every_verdict_of_the_ledger_has_a_table_on_the_page_of_all_claims():
    records = [record(section=claim.section, verdict=claim.verdict) for claim in claims.load_ledger()]
    text = (ROOT / "docs/claims.md").read_text(encoding="utf-8")
    for name in verdicts.tabulate_claims(records):
        assert f"<!-- {name}: begin -->" in text


@pytest.mark.parametrize("content", ["", '[{"id": "4.11", "sta', "\x00"])
def test_damaged_claims_are_refused(tmp_path, content):
    (tmp_path / "claims.json").write_text(content)
    with sentences.raises(StorageError):
        stored.read_records(tmp_path / "claims.json")
    (tmp_path / "claims.json").write_text('[{"id": "4.11"}]')
    assert stored.read_records(tmp_path / "claims.json") == [{"id": "4.11"}]
