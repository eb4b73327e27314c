"""Each set of extras in an empty environment, from the sdist and from the wheel: `make installations`.

`python -m benchmarks.installations` builds both, the wheel from the sdist; installs each set into new
environments, which needs the network; tries it by `tests/smoke.py`; and writes what the wheel takes into
benchmarks/installations.json: seconds, which count what is loaded, MB on the disk, and packages. An empty
environment has some 20 MB, which count on the disk; what is in it does not count among the packages.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path

from benchmarks.whole import ROOT, disk, measure_command

SETS = ("core", "plot", "files", "mesh", "all")
"""The core, and the extras for users of the solver."""
BUILD = "import sys; from setuptools import build_meta; build_meta.build_sdist(sys.argv[1])"
OWN = {"pip", "setuptools"}
"""What an empty environment has."""


@contextmanager
def environment() -> Iterator[Path]:
    """The interpreter of an empty environment, which is removed at the end."""
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([sys.executable, "-m", "venv", folder], check=True)
        yield Path(folder) / "bin/python"


def pip(python: Path, *arguments: str) -> list[str]:
    """The command that runs an environment's pip."""
    return [str(python), "-m", "pip", "--disable-pip-version-check", *arguments]


def build_packages(folder: Path) -> list[Path]:
    """The sdist, and the wheel that pip makes of it. Raises CalledProcessError."""
    subprocess.run([sys.executable, "-c", BUILD, folder], cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
    (sdist,) = folder.glob("*.tar.gz")
    with environment() as python:
        subprocess.run(
            pip(python, "wheel", "-q", "--no-deps", "--wheel-dir", str(folder), str(sdist)), check=True
        )
    return [sdist, *folder.glob("*.whl")]


def try_installation(package: Path, name: str) -> dict[str, float]:
    """Seconds, MB and packages of a set, installed from that file and tried. Raises CalledProcessError."""
    extra = "" if name == "core" else f"[{name}]"
    with environment() as python, tempfile.TemporaryDirectory() as empty:
        installation = measure_command(pip(python, "install", "-q", f"{package}{extra}"))
        size = disk(python.parent.parent)
        smoke = [str(python), "-W", "error", str(ROOT / "tests/smoke.py"), name]
        subprocess.run(smoke, cwd=empty, check=True)
        listed = subprocess.run(pip(python, "list", "--format=json"), check=True, capture_output=True)
    packages = {entry["name"] for entry in json.loads(listed.stdout)} - OWN
    return {"seconds": installation["seconds"], "disk": size, "packages": len(packages)}


def main() -> None:
    """Raises CalledProcessError where a command fails."""
    with tempfile.TemporaryDirectory() as folder:
        sdist, wheel = build_packages(Path(folder))
        for name in SETS:
            try_installation(sdist, name)
        installations = {name: try_installation(wheel, name) for name in SETS}
    stored = {"date": datetime.now(UTC).date().isoformat(), **installations}
    (ROOT / "benchmarks/installations.json").write_text(json.dumps(stored, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
