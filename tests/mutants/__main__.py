"""`make mutants`: each mutant spoils one line of a guarantee, and one of the tests beside it has to fail.

The mutants are those of catalogue.yaml. Each is made in a copy of src, so that the work tree stays as it is.
First all their tests have to pass on a copy without a mutant. `make mutants only="tanh sum"` tries these two.
The exit code is 1 if a mutant survives, if a text is not found exactly once, or if a test is not there or
does not run.
"""

import argparse
import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import yaml

ROOT = Path(__file__).parents[2]
CATALOGUE = Path(__file__).with_name("catalogue.yaml")
LIMIT = 300
"""Seconds for the tests of a mutant."""


class Mutant(NamedTuple):
    """In `file` the `text` is replaced, which is wrong: `why` says it. One of the `tests` has to fail."""

    name: str
    file: str
    text: str
    instead: str
    why: str
    tests: list[str]


class Outcome(NamedTuple):
    """The test that failed, or why none is known to have failed, and the seconds that it took."""

    killed: bool
    message: str
    seconds: float


def read(catalogue: Path) -> list[Mutant]:
    """The mutants of a catalogue."""
    return [Mutant(**entry) for entry in yaml.safe_load(catalogue.read_text(encoding="utf-8"))]


def stale(mutants: list[Mutant], root: Path) -> list[str]:
    """What no longer fits the project, a sentence each."""

    def text(path: str) -> str:
        return (root / path).read_text(encoding="utf-8") if (root / path).exists() else ""

    failures = []
    for mutant in mutants:
        count = text(mutant.file).count(mutant.text)
        if count != 1:
            failures.append(f"{mutant.name}: its text occurs {count} times in {mutant.file}, not once")
        for test in mutant.tests:
            path, _, function = test.partition("[")[0].partition("::")
            if (f"def {function}(" if function else "def test_") not in text(path):
                failures.append(f"{mutant.name}: there is no test {test}")
    names = [mutant.name for mutant in mutants]
    return failures + [f"{name}: two mutants have this name" for name in set(names) if names.count(name) > 1]


@contextmanager
def copy_with_mutant(root: Path, mutant: Mutant | None) -> Iterator[Path]:
    """A copy of src with the mutant in it, for as long as it is needed."""
    with TemporaryDirectory(prefix="mutants-") as folder:
        src = shutil.copytree(root / "src", Path(folder) / "src")
        if mutant:
            path = Path(folder) / mutant.file
            path.write_text(
                path.read_text(encoding="utf-8").replace(mutant.text, mutant.instead), encoding="utf-8"
            )
            for compiled in path.parent.glob(f"__pycache__/{path.stem}.*"):
                compiled.unlink()
        yield src


def try_mutant(tests: list[str], root: Path, mutant: Mutant | None = None) -> Outcome:
    """What the tests say of the mutant; without one they may take as long as they need."""
    options = ["-x", "-q", "-rf", "-p", "no:cacheprovider"]
    start = time.perf_counter()
    with copy_with_mutant(root, mutant) as src:
        path = os.pathsep.join(filter(None, (str(src), os.environ.get("PYTHONPATH"))))
        try:
            done = subprocess.run(
                [sys.executable, "-m", "pytest", *options, *tests],
                cwd=root,
                env=os.environ | {"PYTHONPATH": path},
                capture_output=True,
                text=True,
                timeout=LIMIT if mutant else None,
            )
        except subprocess.TimeoutExpired:
            return Outcome(False, f"the tests did not end in {LIMIT} s", LIMIT)
    seconds = time.perf_counter() - start
    if done.returncode == 0:
        return Outcome(False, "no test failed", seconds)
    failed = re.search(r"^FAILED (\S+::\w+)", done.stdout, re.MULTILINE)
    if done.returncode == 1 and failed:
        return Outcome(True, failed[1], seconds)
    return Outcome(False, f"the tests do not run: {(done.stdout + done.stderr).strip()[-500:]}", seconds)


def kill_all(mutants: list[Mutant], jobs: int, root: Path) -> bool:
    """Whether all mutants are killed, each told when it has been tried, by tests that pass without any."""
    tests = sorted({test for mutant in mutants for test in mutant.tests})
    pool = ThreadPoolExecutor(jobs)
    try:
        shares = filter(None, (tests[k::jobs] for k in range(jobs)))
        for control in pool.map(lambda share: try_mutant(share, root), shares):
            if control.message != "no test failed":
                print(f"without a mutant: {control.message}")
                return False
        print(f"without a mutant {len(tests)} tests pass", flush=True)
        survivors = []
        outcomes = pool.map(lambda mutant: try_mutant(mutant.tests, root, mutant), mutants)
        for k, (mutant, outcome) in enumerate(zip(mutants, outcomes, strict=True)):
            text = (
                f"killed by {outcome.message}"
                if outcome.killed
                else f"SURVIVED, {outcome.message}: {mutant.why}"
            )
            print(f"{k + 1:3} of {len(mutants)} {outcome.seconds:5.1f} s  {mutant.name}: {text}", flush=True)
            survivors += [] if outcome.killed else [mutant.name]
    finally:
        pool.shutdown(cancel_futures=True)
    print(f"survivors: {', '.join(survivors)}" if survivors else f"all {len(mutants)} mutants were killed")
    return not survivors


def main(arguments: list[str], catalogue: Path = CATALOGUE, root: Path = ROOT) -> int:
    """The exit code."""
    parser = argparse.ArgumentParser(prog="python -m tests.mutants", description=__doc__)
    parser.add_argument("only", nargs="*", help="names of mutants; all of them if there are none")
    parser.add_argument("--jobs", type=int, default=2, help="mutants at a time")
    args = parser.parse_args(arguments)
    mutants = read(catalogue)
    if unknown := {*args.only} - {mutant.name for mutant in mutants}:
        parser.error(f"there is no mutant {', '.join(sorted(unknown))} in {catalogue.name}")
    mutants = [mutant for mutant in mutants if not args.only or mutant.name in args.only]
    faults = stale(mutants, root)
    for fault in faults:
        print(fault)
    return int(bool(faults) or not kill_all(mutants, args.jobs, root))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
