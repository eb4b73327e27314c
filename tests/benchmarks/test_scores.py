"""`make score`: what is committed is what the plan asks for, and a tiny run of it."""

import numpy as np
import pandas as pd
import sentences
import yaml
from conftest import ROOT

from benchmarks import numbers as documented
from benchmarks import plan, scores
from unilateral.errors import InputError

COMMITTED = pd.read_csv(ROOT / "benchmarks/scores.csv")
PLAN = plan.read(plan.FOLDER / "benchmarks.yaml")
LAMBDA = 0.02
"""Both stop at 1 % of the error, and differ by no more."""


def test_the_committed_scores_are_those_of_the_plan():
    """A driver or a case that is added, or sizes that change, ask for `make score`."""
    expected = {(solver, case) for solver in PLAN["scores"]["drivers"] for case in PLAN["scores"]["cases"]}
    assert set(zip(COMMITTED["solver"], COMMITTED["case"], strict=True)) == expected
    assert (COMMITTED[["h", "H"]] == [PLAN["scores"]["h"], PLAN["scores"]["H"]]).all(axis=None)
    assert set(documented.PACKAGES) == set(PLAN["scores"]["drivers"])
    assert (COMMITTED["faults"] == 0).all()


def test_the_same_discrete_problem_has_the_same_errors():
    """GetFEM solves this project's discrete problem; the other three solve one, with u >= g at the nodes."""
    same = COMMITTED[COMMITTED["solver"] == "getfem"]
    np.testing.assert_allclose(same[["h1_over_own", "hm12_over_own", "l2_over_own"]], 1, rtol=0, atol=LAMBDA)
    nodal = COMMITTED[COMMITTED["solver"] != "getfem"].set_index(["case", "solver"])
    for _, rows in nodal.groupby("case"):
        errors = rows[["h1_over_own", "hm12_over_own", "l2_over_own"]]
        np.testing.assert_allclose(errors, np.broadcast_to(errors.iloc[0], errors.shape), rtol=1e-3)


def test_a_small_run_scores_skfem_without_a_fault_and_skips_a_missing_solver(monkeypatch, capsys):
    """scikit-fem comes with this project. h = 1/4 and 1/8 have no two levels that count."""
    sizes = {"cases": ["natural"], "h": "1/8", "H": "1/4", "levels": 2}
    drivers = {name: PLAN["scores"]["drivers"][name] for name in ("skfem", "ngsolve")}
    monkeypatch.setenv("UNILATERAL_BENCH_NGSOLVE", "no-such-python")
    (row,) = scores.rows(PLAN | {"scores": sizes | {"drivers": drivers}})
    assert (row["solver"], row["faults"]) == ("skfem", 0)
    assert row["verdict"] == "no fault was found; rates are not judged"
    assert 1 <= row["h1_over_own"] < 1.1
    assert "ngsolve is skipped: no-such-python does not have ngsolve" in capsys.readouterr().err


def test_a_driver_that_fails_is_told(tmp_path):
    (tmp_path / "driver.py").write_text("raise SystemExit('nothing goes')")
    with sentences.raises(InputError):
        scores.solutions(scores.sys.executable, tmp_path / "driver.py", "natural")


def test_a_driver_of_an_unknown_solver_is_refused(tmp_path):
    spoilt = PLAN | {"scores": PLAN["scores"] | {"drivers": {"nobody": "examples/nobody.py"}}}
    (tmp_path / "plan.yaml").write_text(yaml.safe_dump(spoilt))
    with sentences.raises(InputError):
        plan.read(tmp_path / "plan.yaml")
