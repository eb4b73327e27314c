"""The ledger: every claim judged on the stored results, every control seen to fail, and the arithmetic."""

import copy
import hashlib
import json
import os
import re
import shutil
from contextlib import nullcontext
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import sentences
import xarray as xr
from conftest import RESULTS, config, load

from study import tables
from study.documents import marks, verdicts
from study.evidence import Evidence
from study.ledger import claims, controls, entries, listing, records
from study.ledger import results as of_study
from study.ledger.claims import Judgement
from study.ledger.results import Results
from study.ledger.texts import strip_tex
from study.scenes import has_clamped_sides
from unilateral import cli
from unilateral.errors import InputError, StorageError
from unilateral.formulas.formula import parse_real
from unilateral.geometry.polygon import find_polygon
from unilateral.norms.dual import Bracket, Gram
from unilateral.norms.resolution import RULE
from unilateral.problems.case_certificate import certify_case

ALL = {claim.id: claim for claim in claims.load_ledger()}
LEDGER = {name: claim for name, claim in ALL.items() if not claim.unmeasured}
STATEMENTS = re.findall(  # of the paper, that the ledger must not leave out
    r"\S+",
    "1.2 R1.1 1.8 3.1a 3.1b 3.1c 3.5 3.6 3.th 4.1 4.5 4.6 4.7 4.9 4.10 4.11 4.12 4.13 4.14 4.15 4.16a 4.16b "
    "R4.1a R4.1b 5.1 5.2a 5.2b 5.2c 5.3 5.A",
)


@cache
def results():
    return Results(RESULTS)


class Recording(Results):
    """Results that remember which tables were asked for."""

    def __init__(self):
        super().__init__(RESULTS)
        self.asked = set()

    def __getitem__(self, name):
        self.asked.add(name)
        return results()[name]


def judge_claim(name, **spoil):
    """A claim by the stored results, spoilt or not."""
    tables = controls.spoil_results(results(), spoil) if spoil else results()
    return claims.judge_all(tables, [LEDGER[name]])[0]


def test_the_ledger_has_every_statement_once():
    """And no claim that holds says that it does not."""
    ids = [claim.id for claim in claims.load_ledger()]
    assert len(ids) == len(set(ids))
    assert set(STATEMENTS) <= set(ids)
    assert all(records.verdict_holds(claim.verdict) for claim in LEDGER.values())


@pytest.mark.parametrize("change", ["in no section", "in two sections", "declared twice", "declared nowhere"])
def test_a_claim_that_is_not_declared_once_and_named_once_is_told(monkeypatch, change):
    """Control: as they are, all are accepted."""

    def read_changed_ledger(file):
        document = copy.deepcopy(read(file))
        if file.name == "sections.yaml" and change == "in no section":
            document["theorems"].remove("T.D")
        if file.name == "sections.yaml" and change == "in two sections":
            document["cost"].append("T.D")
        if file.parent.name == "sharpness" and change.startswith("declared"):
            claim = next(entry for entry in document["claims"] if entry["id"] == "T.D")
            (document["claims"].append if change == "declared twice" else document["claims"].remove)(claim)
        return document

    read = entries.read_stored_yaml
    assert len(entries.read_entries()) > 100
    monkeypatch.setattr(entries, "read_stored_yaml", read_changed_ledger)
    with sentences.raises(InputError):
        entries.read_entries()


GENERAL = ("id", "section", "title", "statement", "where")
ENTRY = {
    **dict.fromkeys((*GENERAL, "verdict"), "x"),
    **{
        "id": "4.x",
        "check": "scenes.theorem_rate",
        "source": "derived: x",
        "reads": [],
        "control": {"what": "x"},
    },
}


@pytest.mark.parametrize(
    "changed",
    [
        {"check": "scenes.theorem_rates"},
        {"check": "rates.theorem_rate"},
        {"contol": {}},
        {"source": "derived by hand"},
        {"unmeasured": "x"},
    ],
)
def test_an_entry_that_is_no_claim_is_told_by_its_id(changed):
    """Control: as it was it is one."""
    assert claims.read_claim(ENTRY).id == "4.x"
    assert claims.read_claim({**{field: "x" for field in GENERAL}, "unmeasured": "x"}).unmeasured == "x"
    with sentences.raises(InputError):
        claims.read_claim({**ENTRY, **changed})


@pytest.mark.parametrize("name", LEDGER)
def test_the_claim_has_its_verdict_by_the_tables_that_it_names_and_no_others(name):
    """The pipeline feeds the ledger by these names."""
    recording = Recording()
    judgement = claims.judge_all(recording, [LEDGER[name]])[0]
    assert judgement.holds, "\n" + listing.explain_claim(judgement)
    assert recording.asked == set(LEDGER[name].reads)


@pytest.mark.parametrize("name", LEDGER)
def test_the_control_turns_it_to_fails(name):
    judgement = judge_claim(name, **LEDGER[name].control)
    assert judgement.verdict == records.FAILS, "\n" + listing.explain_claim(judgement)


FINEST = {"value": np.nan, "at": {"mesh": -1}}
FAILING = {"value": "fails", "at": {"case": 0}}
UNFIT = [  # a claim, what takes from it what it rests on, and the reason that is told
    ("1.2h", "square/errors", "hm12_error_upper", FINEST, "the finest error .* is not known of square, "),
    ("4.11", "square/rates", "verdict", FAILING, "square, full_contact, h1: fails$"),
    (
        "S.edges",
        "betaworst/infsup",
        "edges_per_cell",
        {"value": 1.0},
        "the smallest .* of betaworst",
    ),
    ("X.rho", "extremes/extremes", "predicted_limit", {"factor": 1.0001}, r"0\.999 of the limit was not"),
]


@pytest.mark.parametrize(("name", "table", "variable", "spoil", "reason"), UNFIT)
def test_a_claim_whose_check_has_nothing_to_rest_on_is_not_judged(name, table, variable, spoil, reason):
    judgement = judge_claim(name, tables=[table], variable=variable, **spoil)
    assert re.match(f"not judged: {reason}", judgement.verdict)
    assert not judgement.holds
    record = judgement.record()
    assert record["verdict"] == judgement.verdict
    assert [record[field] for field in ("quantity", "expected", "observed", "margin")] == 4 * [None]
    assert verdicts.holds_by_claim([record]) == {name: False}


EDGES = {"tables": ["betaworst/infsup"], "variable": "edges_per_cell", "value": 1.0}


def stored_in(folder, *judgements):
    """That folder, with the judgements as the study stores them."""
    (folder / "claims.json").write_text(json.dumps([judgement.record() for judgement in judgements]))
    return str(folder)


def test_what_is_not_judged_is_printed_with_its_reason_and_ends_with_1(capsys, monkeypatch, tmp_path):
    monkeypatch.setattr(of_study, "Results", lambda *_, **__: controls.spoil_results(results(), EDGES))
    reason = "the smallest beta with 2 edges in every cell is not known of betaworst"
    assert cli.main(["claims", "S.edges"]) == 1
    text = capsys.readouterr().out
    assert f"\nverdict: not judged: {reason.replace('beta w', 'β w')}\n" in text
    assert "observed" not in text
    folder = stored_in(tmp_path, judge_claim("S.edges", **EDGES), judge_claim("T.ends"))
    assert cli.main(["claims", "--results", folder]) == 1
    text = capsys.readouterr().out
    assert re.search(r"^S\.edges .* –  .* –  .*NOT JUDGED: the smallest β with", text, re.MULTILINE)
    assert "\n2 claims: 1 hold; 1 do NOT hold: S.edges.\n" in text


def test_a_document_does_not_rest_on_what_is_not_judged(tmp_path):
    """Control: with the study's own records the same sentence is kept."""
    page = tmp_path / "page.md"
    page.write_text("It is <!--?S.edges-->not enough.<!--/-->\n")
    for spoil, retained in (({}, True), (EDGES, False)):
        records = [judge_claim("S.edges", **spoil).record()]
        with nullcontext() if retained else sentences.raises(InputError):
            marks.fill_document(page, {}, {}, verdicts.holds_by_claim(records))


RATES = config("rates")["rates"]
STUDY = config("study")


def test_the_ledger_judges_the_ratio_and_the_norms_as_the_study_declares_them():
    """H/h, also of the study of cost, and the tolerances of rates."""
    ratios = {"cost": parse_real(STUDY["cost"]["base"]["H_over_h"], "")}
    tolerances = {norm: declared["tolerance"] for norm, declared in RATES["norms"].items()}
    count = 0
    for claim in LEDGER.values():
        parameters = {**claim.parameters, **claim.parameters.get("select", {})}
        if "H_over_h" in parameters:
            ratio = ratios.get(claim.section, 1 / parse_real(RATES["judged_ratio"], ""))
            assert parameters["H_over_h"] == ratio, claim.id
        for norm, tolerance in parameters.get("tolerances", {}).items():
            assert tolerance == tolerances[norm], claim.id
        if {"norm", "tolerance"} <= set(parameters):
            assert parameters["tolerance"] == tolerances[parameters["norm"]], claim.id
        if {"norm", "at_least"} <= set(parameters) and parameters["value"].startswith("(rate - predicted)"):
            assert parameters["at_least"] == -tolerances[parameters["norm"]], claim.id
        count += len({"H_over_h", "tolerance", "tolerances"} & set(parameters))
    assert count > 20


def test_the_rule_for_beta_is_the_library_s_and_judged_on_every_survey():
    assert set(LEDGER["S.local"].parameters["scenes"]) == set(STUDY["surveys"])
    for claim in ("T.node", "T.node0", "T.pair", "T.low"):
        assert set(LEDGER[claim].parameters["scenes"]) == {*STUDY["surveys"], "adaptive"}
    for claim in ("S.local", "A.beta"):
        assert f"{RULE.smallest_angle}°" in LEDGER[claim].statement
        assert RULE.cell_over_edge == 2
        assert "half" in LEDGER["S.local"].statement


def test_the_rate_is_judged_of_all_cases_on_adapted_meshes():
    declared = [case for scene in STUDY["adaptive"]["scenes"] for case in scene["cases"]]
    assert LEDGER["A.rate"].parameters["cases"] == declared
    assert LEDGER["A.index"].parameters["select"]["case"] == [
        name for name in declared if not has_clamped_sides(name)
    ]


def exact_orders(scene):
    """p of Proposition S20 for the cases of a scene with bounds; 1 where only u in H2 is asked for."""
    polygon = find_polygon(STUDY["scenes"][scene]["polygon"])
    side = STUDY["scenes"][scene].get("side", 0)
    if polygon.angles.max() >= np.pi:
        return {}
    cases = [load(name, polygon.name, side) for name in STUDY["totals"]["scenes"][scene]]
    rates = {case.name: RATES["cases"][case.name]["hm12"]["rate"] for case in cases}
    return {
        case.name: 1.0
        if case.gap_order <= 3 / 2
        else 1.5
        if rates[case.name] == "exact"
        else parse_real(rates[case.name], "")
        for case in cases
        if certify_case(case).hypotheses["j"]
    }


def test_bounds_become_exact_in_all_cases_of_proposition_s7():
    """Those on convex polygons with u in H2, without clamped sides.

    The gap is in C1 if its order is above 3/2.
    """
    claim = LEDGER["F.exact"].parameters
    scenes = STUDY["totals"]["scenes"]
    scenes = [scene for scene, cases in scenes.items() if not has_clamped_sides(cases[0])]
    orders = {scene: exact_orders(scene) for scene in scenes}
    assert claim["scenes"] == [scene for scene in scenes if orders[scene]]
    assert claim["orders"] == {case: order for by_case in orders.values() for case, order in by_case.items()}
    assert claim["tolerance"] == 2 * RATES["norms"]["hm12"]["tolerance"]


def failing(changed, judged):
    """Those of the claims that fail by the stored results with other tables for some."""
    return {
        judgement.claim.id
        for judgement in claims.judge_all(Results(RESULTS, results() | changed), judged)
        if not judgement.holds
    }


def failing_with_variant(variant):
    """The claims that fail if the algorithm is that variant; only those that read its table can."""
    table = results()["algorithm/steps"].copy(deep=True)
    table["distance"].loc[{"variant": "as meant"}] = table["distance"].sel(variant=variant).values
    touched = [claim for claim in LEDGER.values() if "algorithm/steps" in claim.reads]
    assert len(touched) > 4
    return failing({"algorithm/steps": table}, touched)


def test_without_the_clip_only_its_claims_fail():
    """Another multiplier is reached, and above the limit nothing bounds the iterates."""
    assert failing_with_variant("without the clip") == {"5.3", "5.2b"}


def test_with_the_printed_index_only_its_claims_fail():
    assert failing_with_variant("as printed") == {"5.1", "5.2a"}


def test_with_the_shortcut_for_the_dual_norm_only_the_norm_s_claims_fail(monkeypatch):
    """H^{1/2} ||.||_0 in place of ||.||_{-1/2} on P0(T_H): beta is then beta_0.

    An inverse estimate holds for it, trivially, and rates do not tell it from the norm. But its
    constant is 1, too small for (4.7) where a multiplier is far from its best approximation. All claims are
    measured anew, which takes ten seconds.
    """

    def bracket_by_length(gram):
        lengths = np.diff(gram.points)
        return Bracket(*2 * [np.diag(lengths.max() * lengths)])

    changed = {}
    for name in {name for claim in LEDGER.values() for name in claim.reads if name.endswith("/infsup")}:
        table = results()[name].copy(deep=True)
        changed[name] = table.assign(beta_lower=table["beta_0"], beta_upper=table["beta_0"])
    monkeypatch.setattr(Gram, "p0", property(bracket_by_length))
    assert failing(changed, LEDGER.values()) == {
        "3.1a",
        "3.5",
        "4.7",
        "S.local",
        "T.node",
        "T.fortin",
        "A.beta",
        "C.beta",
    }


def made_up(observed, required, at_least):
    claim = replace(LEDGER["4.1"], verdict="holds")
    return Judgement(claim, Results(RESULTS), Evidence("number", observed, required, at_least, []))


@pytest.mark.parametrize(
    ("observed", "required", "at_least", "margin"),
    [
        (1.2, 1.0, True, 0.2),
        (0.8, 1.0, True, -0.2),
        (0.8, 1.0, False, 0.2),
        (-0.05, -0.1, True, 0.5),
        (1, 0, True, 1),
    ],
)
def test_margins_are_the_relative_distances_to_what_is_required(observed, required, at_least, margin):
    judgement = made_up(observed, required, at_least)
    assert judgement.evidence.margin == pytest.approx(margin)
    assert judgement.holds == (margin >= 0)
    assert made_up(np.nan, required, at_least).verdict == records.FAILS


@pytest.mark.parametrize(
    ("required", "observed", "displayed"),
    [
        (0.0, 0.2, "–"),
        (1.0, 1.2, "20 %"),
        (1.0, np.nan, "–"),
        (1e3, 1.1e9, "> 1000 %"),
        (1.0, -1e9, "< -1000 %"),
    ],
)
def test_margins_are_printed_for_people_and_none_relative_to_0(required, observed, displayed):
    judgement = made_up(observed, required, True)
    assert f"margin {displayed}\n" in listing.explain_claim(judgement)
    line = list(listing.list_claims([judgement.record()]))[2]
    assert re.search(rf"  {re.escape(displayed)} +{judgement.verdict.replace('fails', 'FAILS')}$", line)


def test_one_claim_on_the_command_line(capsys):
    assert cli.main(["claims", "4.12", "--results", str(RESULTS)]) == 0
    text = capsys.readouterr().out
    assert "Theorem 4.1, (4.12)" in text
    assert "irregular, borderline_0.05, hm12: " in text


SECTIONS = list(dict.fromkeys(claim.section for claim in ALL.values()))


def test_all_claims_stand_below_their_sections_with_their_titles(capsys):
    """A pipe has one line for each, whatever the terminal's width is said to be."""
    assert cli.main(["claims", "--results", str(RESULTS)]) == 0
    head, *lines, summary, _ = capsys.readouterr().out.splitlines()
    assert head.split() == ["claim", "title", "observed", "margin", "verdict"]
    assert [line[:-1] for line in lines if line.endswith(":")] == SECTIONS
    displayed = {line.split()[0]: line for line in lines if not line.endswith(":")}
    assert list(displayed) == list(ALL)
    assert all(strip_tex(ALL[name].title) in line for name, line in displayed.items())
    assert (
        summary
        == f"{len(ALL)} claims: {len(LEDGER)} hold; in {len(ALL) - len(LEDGER)} there is nothing to measure."
    )


@pytest.mark.parametrize("width", [80, 100, 200])
def test_all_claims_fit_a_terminal(width):
    """No word is lost. Control: without a width some verdicts are longer."""
    stored = listing.read_claim_records(RESULTS)
    lines = list(listing.list_claims(stored, width))
    unbroken = list(listing.list_claims(stored))
    assert max(map(len, lines)) <= width < max(map(len, unbroken))
    begin = lines[0].index("verdict")
    verdicts = " ".join(line[begin:] for line in lines[:-3] if not line.endswith(":"))
    assert "is an error of the source; its section 5 has the right 1/2" in verdicts
    assert ("observed" in lines[0]) == (width > 80)


def test_stored_claims_are_those_that_the_manifest_lists(tmp_path):
    """Controls: without a manifest, and with the right digest, they are read."""
    folder = stored_in(tmp_path, judge_claim("4.14"))
    assert [claim_record["id"] for claim_record in listing.read_claim_records(folder)] == ["4.14"]
    right = hashlib.sha256((tmp_path / "claims.json").read_bytes()).hexdigest()
    for digest, fits in ((right, True), ("0" * 64, False)):
        listed = {"path": "results/claims.json", "sha256": digest}
        (tmp_path / "manifest.json").write_text(json.dumps({"files": [listed]}))
        with nullcontext() if fits else pytest.raises(StorageError, match="another version"):
            listing.read_claim_records(folder)


def test_a_failing_claim_ends_with_1(capsys, monkeypatch):
    """Control."""
    spoilt = controls.spoil_results(results(), LEDGER["4.14"].control)
    monkeypatch.setattr(of_study, "open_finished_results", lambda _: spoilt)
    assert cli.main(["claims", "4.14"]) == 1
    assert "verdict: fails" in capsys.readouterr().out


def test_unknown_claims_and_missing_tables_are_bad_input(capsys, tmp_path):
    assert cli.main(["claims", "9.9"]) == 2
    assert "there is no claim '9.9'; did you mean 4.9?; 'unilateral claims' lists" in capsys.readouterr().err
    assert cli.main(["claims", "1.2", "--results", str(tmp_path)]) == 2
    assert "there is no table" in capsys.readouterr().err
    assert cli.main(["claims", "--results", str(tmp_path)]) == 2
    assert "there are no judged claims in" in capsys.readouterr().err
    with pytest.raises(InputError):
        Results(tmp_path)["square/errors"]


@pytest.fixture
def study(tmp_path):
    """A study that has ended: two tables and the manifest that lists them."""
    paths = [tmp_path / f"results/{name}.nc" for name in ("square/errors", "square/timings")]
    paths[0].parent.mkdir(parents=True)
    for path in paths:
        tables.save_table(xr.Dataset({"x": 1.0}), path, "square")
    listed = {"path": "results/square/errors.nc", "sha256": hashlib.sha256(paths[0].read_bytes()).hexdigest()}
    (tmp_path / "results/manifest.json").write_text(json.dumps({"files": [listed]}))
    return tmp_path / "results"


def test_a_table_of_another_version_than_the_manifest_lists_is_refused(study):
    """Of the same place and parameters. Controls: the listed one, one that is not listed, no manifest."""
    finished_results = of_study.open_finished_results(study)
    assert finished_results["square/errors"].x == finished_results["square/timings"].x == 1
    tables.save_table(xr.Dataset({"x": np.nextafter(1.0, 2)}), study / "square/errors.nc", "square")
    text = r"square/errors\.nc is another version than the study ended with: its SHA-256 is \w{16}"
    with pytest.raises(
        StorageError, match=text + r".*, and .*manifest\.json has \w{16}\.\.\.; 'snakemake -j2 -f "
    ):
        of_study.open_finished_results(study)["square/errors"]
    with pytest.raises(StorageError, match=text):
        Results(study, {}, of_study.open_finished_results(study).listed_digests)["square/errors"]
    (study / "manifest.json").unlink()
    assert of_study.open_finished_results(study)["square/errors"].x > 1


@pytest.mark.parametrize("content", ["{}", "[]", '{"files": [{}]}', '{"files": [3]}'])
def test_what_is_no_manifest_is_refused(study, content):
    (study / "manifest.json").write_text(content)
    with sentences.raises(StorageError):
        of_study.open_finished_results(study)


def test_no_statement_is_printed_with_tex():
    """On the terminal. Control: statements have TeX."""
    statements = [claim.statement for claim in claims.load_ledger()]
    assert not [item for item in map(strip_tex, statements) if "\\" in item or "$" in item]
    assert any("\\" in statement for statement in statements)


def test_claims_are_not_judged_by_exchanged_tables(capsys, tmp_path):
    """Of the stored results, all others linked."""
    shutil.copytree(RESULTS, tmp_path / "results", copy_function=os.symlink)
    for first, second in (("square", "unstructured"), ("unstructured", "square")):
        path = tmp_path / f"results/{first}/rates.nc"
        path.unlink()
        path.symlink_to(RESULTS / f"{second}/rates.nc")
    assert cli.main(["claims", "4.12", "--results", str(tmp_path / "results")]) == 4
    text = "square/rates.nc is the table 'unstructured/rates', and 'square/rates' is expected; 'snakemake"
    assert text in capsys.readouterr().err
