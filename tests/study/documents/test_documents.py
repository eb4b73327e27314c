"""The committed documents are what the pipeline writes from the stored results; tables in Markdown."""

import re
from pathlib import Path

import documents
import pandas as pd
import pytest
from conftest import ROOT

from study import config
from study.documents import marks, numbers, verdicts
from study.ledger import records
from unilateral.errors import InputError

CONFIG = [
    f"workflow/config/{name}.yaml" for name in ("study", "rates", "worst_infsup", "extremes", "figures")
]
DOCUMENTS = [
    "README.md",
    "paper.md",
    "supplement.md",
    *sorted(f"docs/{file.name}" for file in (ROOT / "docs").glob("*.md")),
]


@pytest.fixture(scope="module")
def stored_evidence():
    """The numbers, the blocks and the claims that hold, as they are stored."""
    stored = [records.read_records(ROOT / f"results/{name}.json") for name in ("numbers", "blocks", "claims")]
    return *stored[:2], verdicts.holds_by_claim(stored[2])


def text(document):
    return (ROOT / document).read_text(encoding="utf-8")


def test_every_document_is_filled_by_the_study():
    study, _ = config.read_configuration([str(ROOT / file) for file in CONFIG])
    assert study["documents"] == DOCUMENTS


@pytest.mark.parametrize("document", DOCUMENTS)
def test_a_document_is_what_the_pipeline_writes(tmp_path, document, stored_evidence):
    copy = tmp_path / Path(document).name
    copy.write_text(text(document), encoding="utf-8")
    marks.fill_document(copy, *stored_evidence)
    assert copy.read_text(encoding="utf-8") == text(document), (
        f"{document} is not up to date; run 'snakemake -j2 -f documents'"
    )


def test_another_number_would_be_noticed(tmp_path, stored_evidence):
    """Control."""
    copy = tmp_path / "README.md"
    copy.write_text(text("README.md"), encoding="utf-8")
    numbers, tables, holding = stored_evidence
    marks.fill_document(copy, {**numbers, "claims.S.edges.observed": 0.25}, tables, holding)
    assert "-->0.25<!--/-->" in copy.read_text(encoding="utf-8")
    assert copy.read_text(encoding="utf-8") != text("README.md")


def guards(document: str) -> set[str]:
    """The claims on which its sentences rest."""
    return {name for names in re.findall(r"<!--\?(\S+?)-->", text(document)) for name in names.split(",")}


GUARDED = sorted(set.union(*map(guards, DOCUMENTS)))


@pytest.mark.parametrize("claim", GUARDED)
def test_a_claim_that_fails_stops_a_document_that_rests_on_it(tmp_path, claim, stored_evidence):
    """For one, that `natural` is the only case for which a tenth is not enough."""
    resting = [document for document in DOCUMENTS if claim in guards(document)]
    numbers, tables, holding = stored_evidence
    for document in resting:
        copy = tmp_path / Path(document).name
        copy.write_text(text(document), encoding="utf-8")
        with pytest.raises(
            InputError, match=rf"{copy.name}, line \d+, '.+': claim {re.escape(claim)}, .* does not hold"
        ):
            marks.fill_document(copy, numbers, tables, {**holding, claim: False})


def test_the_recommendation_rests_on_the_claim_of_its_exception():
    assert "but `natural`,<!--/-->" in text("docs/results.md").partition("<!--?5.K-->")[2]


def test_every_table_is_shown_and_every_number_of_an_experiment_is_named(stored_evidence):
    """Claims and costs of the whole study have numbers by one rule, of which only some are named."""
    numbers, tables, _ = stored_evidence
    everything = "".join(text(document) for document in DOCUMENTS)
    assert set(tables) == set(re.findall(r"^<!-- ([\w-]+): begin -->$", everything, re.MULTILINE))
    used = set(re.findall(r"<!--=([\w.]+)", everything))
    unused = {name for name in numbers if name not in used}
    assert {name for name in unused if not name.startswith(("claims.", "whole."))} == set()
    assert {name.split(".")[0] for name in unused} == {"claims", "whole"}


def test_links_to_other_pages_lead_somewhere():
    for document in DOCUMENTS:
        for link in re.findall(r"\]\((?!https?:|#)([^)#\s]+)", text(document)):
            assert ((ROOT / document).parent / link).exists(), f"{document}: {link}"


def test_columns_are_aligned_unless_the_table_is_wide():
    narrow = pd.DataFrame({"a": ["1.50", "10"], "b|": ["x", "$\\|y\\|$"]})
    lines = numbers.format_markdown(narrow).splitlines()
    assert lines[2:] == ["| 1.50 | x       |", "| 10   | $\\|y\\|$ |"]
    wide = pd.DataFrame({"a": ["1.50", "10"], "b": ["x", "y" * 200]})
    assert numbers.format_markdown(wide).splitlines()[2:] == ["| 1.50 | x |", f"| 10 | {'y' * 200} |"]


def test_names_lead_through_groups():
    assert numbers.flatten_groups({"a": {"b": 1, "c": {"d": "x"}}, "e": 2.0, "f": [3]}) == {
        "a.b": 1,
        "a.c.d": "x",
        "e": 2.0,
    }


def test_CI_runs_the_commands_of_README():
    (block,) = [block for block in documents.blocks("README.md") if block.text.startswith("make")]
    commands = [line.partition("#")[0].strip() for line in block.text.splitlines()]
    script = (ROOT / ".ci/run").read_text(encoding="utf-8").splitlines()
    assert commands == [line for line in script if line.startswith("make")] == ["make", "make test"]


def test_claims_are_counted_and_those_with_a_margin():
    """By hand: of four claims one has no check, and one requires 0, to which no margin is relative."""
    derived = {"source": "derived: it is so", "expected": ">= 2", "margin": 0.5}
    none = dict.fromkeys(("source", "expected", "margin"))
    claims = numbers.count_claims([derived, derived, {**derived, "expected": "<= 0"}, none])
    assert (claims["all"], claims["unmeasured"], claims["margins"]) == (3, 1, 2)
