"""The manifest: what it tells of files, and that it is that of the stored results."""

import json
import re
import subprocess
import tomllib

import pytest
from conftest import ROOT

from study import manifest

ABC = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"
"""The SHA-256 of "abc", an example of FIPS 180-4."""


def run_sha256sum(folder):
    """What `sha256sum` says of the files, without this project."""
    return subprocess.run(
        ["sha256sum", "-c", "--quiet", "results/SHA256SUMS"], cwd=folder, capture_output=True, text=True
    )


@pytest.fixture
def written(tmp_path, monkeypatch):
    """A study of two rules; writes its manifest and returns it."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "results").mkdir()
    for name in ("errors.nc", "timings.nc", "claims.json"):
        (tmp_path / "results" / name).write_text("abc")

    def write(study):
        files_by_rule = {
            "solve": ["results/errors.nc", "results/timings.nc"],
            "claims": ["results/claims.json"],
        }
        paths = {"manifest": tmp_path / "results/manifest.json", "sums": tmp_path / "results/SHA256SUMS"}
        manifest.write_manifest(study, files_by_rule, **paths)
        return (tmp_path / "results/manifest.json").read_bytes()

    return write


def test_files_are_told_with_rule_size_and_sum(written):
    assert json.loads(written({}))["files"] == [
        {"path": "results/errors.nc", "rule": "solve", "bytes": 3, "sha256": ABC},
        {"path": "results/claims.json", "rule": "claims", "bytes": 3, "sha256": ABC},
    ]


def test_a_changed_file_is_found_without_this_project(written, tmp_path):
    written({})
    assert run_sha256sum(tmp_path).returncode == 0
    (tmp_path / "results/claims.json").write_text("abd")
    process = run_sha256sum(tmp_path)
    assert (process.returncode, process.stdout) == (1, "results/claims.json: FAILED\n")


def test_two_runs_with_one_result_have_one_manifest(written, tmp_path):
    """Seconds and memory change from run to run; a parameter, and a result, make another manifest."""
    first = written({"h": "1/8", "H": "1/4"})
    (tmp_path / "results/timings.nc").write_text("other seconds")
    assert written({"H": "1/4", "h": "1/8"}) == first
    assert written({"h": "1/8", "H": "1/2"}) != first
    (tmp_path / "results/errors.nc").write_text("other errors")
    assert written({"h": "1/8", "H": "1/4"}) != first


def test_versions_are_those_of_what_the_study_needs():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]
    needed = [*project["dependencies"]]
    for extra in ("study", "all", "files", "mesh", "plot"):
        needed += extras[extra]
    position = [requirement for requirement in needed if "sys_platform == " not in requirement]
    names = {re.match(r"[\w.-]+", requirement)[0] for requirement in position}
    assert manifest.package_versions().keys() == names | {"unilateral", "Python"}
    assert manifest.package_versions()["unilateral"] == project["version"]


def test_the_stored_manifest_is_that_of_the_results():
    process = run_sha256sum(ROOT)
    assert (process.returncode, process.stdout, process.stderr) == (0, "", "")
