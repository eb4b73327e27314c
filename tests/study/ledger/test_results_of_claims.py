"""`unilateral claims` on the study's results."""

import json
from functools import cache

import pytest
from conftest import RESULTS, ROOT

from study.ledger import claims, controls, results
from unilateral.cli import main

pytestmark = pytest.mark.usefixtures("measured_once", "read_once")


@pytest.fixture(scope="module")
def tables_of():
    return cache(results.load_table)


@pytest.fixture
def read_once(monkeypatch, tables_of):
    """A table is the same object for all tests, so that what a claim measures on it is measured once."""
    monkeypatch.setattr(results, "load_table", tables_of)


@pytest.mark.parametrize("claim", [[], ["4.12"]])
def test_the_examples_of_help_work_as_typed(monkeypatch, capsys, claim):
    """Where the results are: every claim of the study holds. A spoilt one would end with 1.

    To judge all takes ten seconds, once.
    """
    monkeypatch.chdir(ROOT)
    assert main(["claims", *claim]) == 0
    out, err = capsys.readouterr()
    assert (out != "", err) == (True, "")


def read_stored_claims():
    return json.loads((RESULTS / "claims.json").read_text())


def read_printed_claims(capsys, *arguments):
    """The claims that are printed as JSON."""
    assert main(["claims", *arguments, "--json", "--results", str(RESULTS)]) == 0
    out, err = capsys.readouterr()
    assert (err, out.count("\n")) == ("", 1)
    return json.loads(out)["claims"]


def test_json_has_what_is_stored_and_whether_it_holds(capsys):
    output = read_printed_claims(capsys)
    assert [
        {name: claim[name] for name in read_stored_claims()[0]} for claim in output
    ] == read_stored_claims()
    for entry in output:
        if not claims.find_claim(entry["id"]).check:
            assert [entry[name] for name in ("holds", "observed", "control", "sees")] == 4 * [None]
            continue
        assert entry["holds"]
        assert entry["sees"]
        assert float(entry["expected"].split()[1]) == entry["required"]


def test_what_is_stored_is_what_is_judged_now(capsys):
    """A claim that were judged otherwise than in the pipeline would differ.

    A seventh of the claims: to find what each sees takes time.
    """
    some = claims.load_ledger()[::7]
    judged = [
        judgement.record() for judgement in claims.judge_all(results.open_finished_results(RESULTS), some)
    ]
    assert judged == [
        judgement for judgement in read_stored_claims() if judgement["id"] in {claim.id for claim in some}
    ]
    assert len(judged) > 12
    everything = {judgement["id"]: judgement for judgement in read_printed_claims(capsys)}
    assert read_printed_claims(capsys, "4.14") == [everything["4.14"]]


def test_one_claim_that_fails_is_json_with_code_1(capsys, monkeypatch):
    """Control, by the claim's own."""
    claim = claims.find_claim("4.14")
    spoilt = controls.spoil_results(results.Results(RESULTS), claim.control)
    monkeypatch.setattr(results, "Results", lambda *_, **__: spoilt)
    assert main(["claims", "4.14", "--json"]) == 1
    (computed,) = json.loads(capsys.readouterr().out)["claims"]
    assert (computed["id"], computed["holds"], computed["verdict"]) == ("4.14", False, "fails")


def test_bad_input_leaves_standard_output_empty(capsys, tmp_path):
    assert main(["claims", "--json", "--results", str(tmp_path)]) == 2
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1)
