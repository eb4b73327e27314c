"""The price of trust: a bound, its certificate, and the check of that; writes benchmarks/trust.json.

README's problem on uniform meshes. With sizes, as in `python -m benchmarks.trust 16`, these only, and nothing
is written. This process uses Python's own modules only while it measures: a process that is started counts
the peak memory of who starts it.
"""

from __future__ import annotations

import gzip
import json
import os
import resource
import subprocess
import sys
import time
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
PROBLEM = "examples/arch.yaml"
SIZES = (16, 32, 64, 100)
"""1/h; a mesh has 10/h^2 triangles."""
REPEATS = 3
CHECKERS = {"check": "check.py", "check_formulas": "check_formulas.py"}
"""The programs in the folder `certificate`, by the names of what is measured."""
WAVE = " + sin(x*y)/1000"
"""A formula that is a polynomial would be read exactly; the bound is larger by what this adds to f."""
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")
Part = dict[str, float]


def row(n: int) -> dict[str, Any]:
    """Costs of each part at h = 1/n: medians of its processor seconds, and its peak MB of 2^20 bytes."""
    with TemporaryDirectory() as folder:
        polynomials = Path(folder, "polynomials.json.gz")
        formulas = Path(folder, "formulas.json.gz")
        runs = [measure_parts(n, polynomials, formulas) for _ in range(REPEATS)]
        size = polynomials.stat().st_size / 2**20
    medians = {
        name: {unit: median(run[name][unit] for run in runs) for unit in ("seconds", "mb")}
        for name in ("solve", "bound", "certificate", *CHECKERS)
    }
    return {"n": n, "triangles": runs[0]["triangles"], "file_mb": size, **medians}


def measure_parts(n: int, polynomials: Path, formulas: Path) -> dict[str, Any]:
    """All parts once: the program in one process, then a process for each checker."""
    output, _ = process([sys.executable, "-m", "benchmarks.trust", "--program", str(n), str(polynomials)])
    certificate = json.loads(gzip.decompress(polynomials.read_bytes()))
    formulas.write_bytes(gzip.compress(json.dumps(replace_terms_by_formulas(certificate)).encode()))
    files = {"check": polynomials, "check_formulas": formulas}
    checks = {name: run_checker(program, files[name]) for name, program in CHECKERS.items()}
    return {**json.loads(output), **checks}


def run_checker(program: str, certificate: Path) -> Part:
    """Costs of a checker, from its start to its end. Raises CalledProcessError if it refuses."""
    return process([sys.executable, "-I", str(ROOT / "certificate" / program), str(certificate)])[1]


def process(command: list[str]) -> tuple[str, Part]:
    """A command's output, processor seconds and peak MB. Raises CalledProcessError if it fails."""
    environment = {**os.environ, **dict.fromkeys(THREADS, "1")}
    running = subprocess.Popen(command, cwd=ROOT, env=environment, stdout=subprocess.PIPE, text=True)
    assert running.stdout is not None  # it is a pipe
    with running.stdout as printed:
        output = printed.read()
    _, status, resources = os.wait4(running.pid, 0)
    running.returncode = os.waitstatus_to_exitcode(status)
    if running.returncode:
        raise subprocess.CalledProcessError(running.returncode, command)
    return output, {"seconds": resources.ru_utime + resources.ru_stime, "mb": resources.ru_maxrss / 2**10}


def program(n: int, certificate: str) -> dict[str, Any]:
    """Seconds of solve, bound and certificate, and the peak MB from the start to the end of each.

    A coarse mesh comes first and does not count: modules are imported with it.
    """
    import unilateral as ul

    ul.solve(ROOT / PROBLEM, h=1 / 4, H=1 / 2).save_certificate(certificate)
    stages: dict[str, Any] = {}
    times = [time.process_time()]

    def end_stage(stage: str) -> None:
        """Note the seconds since the stage before, and the peak memory so far."""
        times.append(time.process_time())
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**10
        stages[stage] = {"seconds": times[-1] - times[-2], "mb": peak}

    s = ul.solve(ROOT / PROBLEM, h=1 / n, H=2 / n, mesh="structured")
    end_stage("solve")
    replace(s.solved).bound()  # which does not know the bound that the solve may have needed
    end_stage("bound")
    s.save_certificate(certificate)
    end_stage("certificate")
    return {"triangles": len(s.mesh.triangles), **stages}


def replace_terms_by_formulas(certificate: dict[str, Any]) -> dict[str, Any]:
    """A copy of the certificate with formulas in place of its polynomials, and WAVE added to f."""
    problem = certificate["problem"]
    sides = [{kind: formula(terms) for kind, terms in side.items()} for side in problem["sides"]]
    return {**certificate, "problem": {**problem, "f": formula(problem["f"]) + WAVE, "sides": sides}}


def formula(terms: list[tuple[int, int, str]]) -> str:
    """The text of a polynomial, a list of [i, j, coefficient of x^i y^j]."""
    return " + ".join(f"({c})*x**{i}*y**{j}" for i, j, c in terms) or "0"


def main(sizes: list[str]) -> None:
    """Raises CalledProcessError where a part fails."""
    rows = []
    for n in map(int, sizes or SIZES):
        rows.append(row(n))
        print(json.dumps(rows[-1]), flush=True)
    if not sizes:
        from benchmarks.machine import processor

        today = datetime.now(UTC).date().isoformat()
        stored = {"date": today, "processor": processor(), "problem": PROBLEM, "rows": rows}
        (ROOT / "benchmarks/trust.json").write_text(json.dumps(stored, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    if sys.argv[1:2] == ["--program"]:
        print(json.dumps(program(int(sys.argv[2]), sys.argv[3])))
    else:
        main(sys.argv[1:])
