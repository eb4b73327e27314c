"""The price of trust: what is measured, the formulas of a certificate, the table, and what is committed."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from conftest import ROOT

from benchmarks import numbers as documented
from benchmarks import trust

PARTS = ("solve", "bound", "certificate", "check", "check_formulas")


def test_formulas_are_the_polynomials() -> None:
    """-3/4 + 2 x y^2 at x = 2, y = 3: by hand 35.25. Sides keep their kinds, and f alone is changed."""
    terms = [[0, 0, "-3/4"], [1, 2, "2"]]
    assert eval(trust.formula(terms), {"x": 2, "y": 3}) == 35.25  # type: ignore[arg-type]
    assert trust.formula([]) == "0"
    certificate = {"v": [1], "problem": {"k": "1", "f": terms, "sides": [{"contact": []}, {"free": terms}]}}
    rewritten = trust.replace_terms_by_formulas(certificate)
    assert rewritten["problem"]["sides"] == [{"contact": "0"}, {"free": trust.formula(terms)}]
    assert rewritten["problem"]["f"] == trust.formula(terms) + trust.WAVE
    assert (rewritten["v"], rewritten["problem"]["k"]) == ([1], "1")
    assert certificate["problem"]["f"] is terms


def test_a_process_is_measured_and_one_that_fails_stops_all() -> None:
    """100 MB are held; the process that starts it holds some itself, so there is no upper limit here."""
    output, took = trust.process([sys.executable, "-c", "x = b'1' * 100 * 2**20; print(7)"])
    assert output == "7\n"
    assert took["mb"] > 100
    assert took["seconds"] > 0
    with pytest.raises(subprocess.CalledProcessError):
        trust.process([sys.executable, "-c", "raise SystemExit(1)"])


def test_a_row_has_medians_of_all_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    """The three runs take 3, 1 and 2 s for each part."""
    seconds = iter([3.0, 1.0, 2.0])

    def measure_by_hand(n: int, path: Path, formulas: Path) -> dict[str, Any]:
        path.write_bytes(bytes(2**20))
        took = next(seconds)
        return {
            "triangles": 10 * n**2,
            **{component: {"seconds": took, "mb": 10 * took} for component in PARTS},
        }

    monkeypatch.setattr(trust, "measure_parts", measure_by_hand)
    row = trust.row(4)
    assert (row["n"], row["triangles"], row["file_mb"]) == (4, 160, 1.0)
    assert all(row[component] == {"seconds": 2.0, "mb": 20.0} for component in PARTS)


def test_a_tiny_mesh_is_measured_and_proved(tmp_path: Path) -> None:
    """160 triangles, whose certificate both checkers prove; a spoilt one stops the benchmark."""
    path = tmp_path / "given.json.gz"
    formulas = tmp_path / "formulas.json.gz"
    row = trust.measure_parts(4, path, formulas)
    assert row["triangles"] == 160
    assert all(row[component]["seconds"] > 0 and row[component]["mb"] > 0 for component in PARTS)
    spoilt = tmp_path / "spoilt.json"
    spoilt.write_text("{}")
    with pytest.raises(subprocess.CalledProcessError):
        trust.run_checker("check.py", spoilt)


def make_results() -> dict[str, Any]:
    by_part = {component: {"seconds": 1.0, "mb": 50.0} for component in PARTS} | {
        "check": {"seconds": 8.0, "mb": 160.4}
    }
    return {"date": "today", "rows": [{"n": 100, "triangles": 100_000, "file_mb": 3.34, **by_part}]}


def test_the_table_has_seconds_also_per_triangle_and_memory() -> None:
    """8 s over 100 000 triangles are 80 microseconds; solve and bound take 2 s."""
    table = documented.trust(make_results())
    assert table.columns.tolist() == ["part", "100 000 triangles", "each", "memory"]
    assert table.iloc[3].tolist() == ["`check.py`", "8 s", "80 µs", "160 MB"]
    assert documented.trust_numbers(make_results())["over_ours"] == 4


def test_what_is_committed_has_all_parts_of_all_sizes() -> None:
    stored = json.loads((ROOT / "benchmarks/trust.json").read_text(encoding="utf-8"))
    assert set(stored) == {"date", "processor", "problem", "rows"}
    assert [row["n"] for row in stored["rows"]] == list(trust.SIZES)
    for row in stored["rows"]:
        assert set(row) == {"n", "triangles", "file_mb", *PARTS}
        assert row["triangles"] == 10 * row["n"] ** 2
        assert all(
            set(row[component]) == {"seconds", "mb"} and min(row[component].values()) > 0
            for component in PARTS
        )
