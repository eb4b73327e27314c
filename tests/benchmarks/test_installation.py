"""What an installation takes: memory of a process and its children, and the disk."""

import json
import subprocess
import sys

import pytest
import smoke

from benchmarks import installations, whole

HOLD = "import time; held = b'x' * {mb} * 2**20; time.sleep(1)"
MB = 200


def test_the_memory_is_that_of_a_command_and_its_children():
    """Two processes hold 200 MB each at one time; Python itself takes some 10."""
    child = f"import subprocess, sys; subprocess.Popen([sys.executable, '-c', {HOLD.format(mb=MB)!r}]); "
    measurement = whole.measure_command([sys.executable, "-c", child + HOLD.format(mb=MB)])
    assert 2 * MB <= measurement["memory"] < 2 * MB + 100


def test_a_command_that_fails_is_no_measurement():
    with pytest.raises(subprocess.CalledProcessError):
        whole.measure_command([sys.executable, "-c", "raise SystemExit(1)"])


def test_the_disk_counts_files_in_folders_too(tmp_path):
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder/file").write_bytes(b"x" * 3 * whole.MB)
    assert whole.disk(tmp_path) == pytest.approx(3, abs=0.1)  # blocks of the file system


def test_each_set_that_is_measured_is_tried_and_told():
    """By `make installations`, and each by its own name."""
    assert [*installations.SETS] == [*smoke.HAS]
    document = json.loads((whole.ROOT / "benchmarks/installations.json").read_text(encoding="utf-8"))
    assert [*document] == ["date", *installations.SETS]
    assert document["core"]["packages"] < min(document[name]["packages"] for name in installations.SETS[1:])
    assert max(value["disk"] for name, value in document.items() if name != "date") == document["all"]["disk"]
