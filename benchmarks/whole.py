"""What the study takes: `python3 -m benchmarks.whole` in a fresh clone writes benchmarks/whole.json.

It runs `make`, then `make test`. Times are those of the clock, and
count what is loaded from the network; memory is the largest sum over all processes that run at one time.
Only Python's own modules are used, for nothing else is there yet.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from datetime import UTC, datetime
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
LOOK = 0.2
"""Seconds from one look at the memory to the next."""
MB = 2**20


def measure_command(command: list[str]) -> dict[str, float]:
    """Seconds of a command, and the MB of it and all that it started. Raises CalledProcessError."""
    start = time.perf_counter()
    peak = 0.0
    with subprocess.Popen(command, cwd=ROOT, start_new_session=True) as running:
        while running.poll() is None:
            peak = max(peak, resident(running.pid))
            time.sleep(LOOK)
    if running.returncode:
        raise subprocess.CalledProcessError(running.returncode, command)
    return {"seconds": time.perf_counter() - start, "memory": peak}


def resident(session: int) -> float:
    """MB of all processes of a session."""
    pages = 0
    for process in Path("/proc").glob("[0-9]*"):
        try:
            if os.getsid(int(process.name)) == session:
                pages += int((process / "statm").read_text(encoding="ascii").split()[1])
        except (OSError, IndexError):  # it has ended meanwhile
            continue
    return pages * os.sysconf("SC_PAGE_SIZE") / MB


def disk(folder: Path) -> float:
    """MB of the files in a folder."""
    return sum(path.lstat().st_blocks * 512 for path in folder.rglob("*") if not path.is_dir()) / MB


def main() -> None:
    """Raises CalledProcessError where a command fails."""
    if (ROOT / ".venv").exists() or (ROOT / "results").exists():
        sys.exit("benchmarks.whole: .venv or results/ is there; run it in a fresh clone")
    totals = {
        "study": {**measure_command(["make"]), "disk": disk(ROOT)},
        "tests": measure_command(["make", "test"]),
    }
    stored = {"date": datetime.now(UTC).date().isoformat(), "cores": os.cpu_count(), **totals}
    (ROOT / "benchmarks/whole.json").write_text(json.dumps(stored, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
