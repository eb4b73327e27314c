"""What the study made, by which rule, from which parameters and with which versions; and its checksums."""

from __future__ import annotations

import json
import os
import platform
from collections.abc import Iterable, Mapping
from hashlib import sha256
from importlib.metadata import requires, version
from pathlib import Path
from typing import Any

from packaging.requirements import Requirement

from study.table_origin import TIMINGS_ENDING
from unilateral import __version__
from unilateral.system.files import replacing


def write_manifest(
    study: Mapping[str, Any],
    files_by_rule: Mapping[str, Iterable[str]],
    manifest: str | os.PathLike[str],
    sums: str | os.PathLike[str],
) -> None:
    """Write the manifest (JSON) of the files that each rule made, and their sums for `sha256sum -c`.

    `study` is the configuration, and `files_by_rule` the files by rule. Files that depend on the machine are
    left out, so that two runs with the same results have the same manifest.
    """
    files = []
    for rule, paths in files_by_rule.items():
        for path in paths:
            if not path.endswith(TIMINGS_ENDING):
                content = Path(path).read_bytes()
                checksum = sha256(content).hexdigest()
                files.append({"path": path, "rule": rule, "bytes": len(content), "sha256": checksum})
    record = {"versions": package_versions(), "parameters": digest_configuration(study), "files": files}
    lines = [f"{file['sha256']}  {file['path']}\n" for file in files]
    with replacing(manifest) as new_manifest, replacing(sums) as new_sums:
        new_manifest.write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")
        new_sums.write_text("".join(lines), encoding="utf-8")


def digest_configuration(study: Mapping[str, Any]) -> str:
    """The SHA-256 of the configuration as JSON with sorted keys."""
    return sha256(json.dumps(study, sort_keys=True).encode()).hexdigest()


def package_versions() -> dict[str, str]:
    """The versions of this package, Python, and the packages that pyproject.toml names for the study."""
    versions = {"unilateral": __version__, "Python": platform.python_version()}
    return versions | {name: version(name) for name in sorted(_required_packages("study"))}


def _required_packages(extra: str) -> set[str]:
    """The names of the packages that this one needs here with that extra, which may name others."""
    names = set()
    for requirement in map(Requirement, requires("unilateral") or []):
        if requirement.marker is None or requirement.marker.evaluate({"extra": extra}):
            names |= (
                set().union(*map(_required_packages, requirement.extras))
                if requirement.name == "unilateral"
                else {requirement.name}
            )
    return names
