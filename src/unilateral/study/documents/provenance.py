"""What the results were made with: versions, files by rule, and parameters, as tables in Markdown."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import pandas as pd

from unilateral.study.documents.blocks import markdown

MEGABYTE = 1e6


def blocks(manifest: Mapping[str, Any], parameters: Iterable[str]) -> dict[str, str]:
    """Blocks by their names, from the study's manifest and the files that hold its parameters."""
    versions = pd.DataFrame(manifest["versions"].items(), columns=["package", "version"])
    digest = f"SHA-256 of the configuration: `{manifest['parameters']}`"
    return {
        "versions": markdown(versions),
        "files": markdown(_files(pd.DataFrame(manifest["files"]))),
        "parameters": "\n\n".join([digest, *map(_quoted, parameters)]),
    }


def _files(files: pd.DataFrame) -> pd.DataFrame:
    """How many files each rule made, and how large they are."""
    by_rule = files.groupby("rule", sort=False)["bytes"]
    size = by_rule.sum().map(lambda size: f"{size / MEGABYTE:.2g}")
    return pd.DataFrame({"files": by_rule.size().astype(str), "MB": size}).reset_index()


def _quoted(path: str) -> str:
    """The text of a file as code, below its name."""
    return f"## `{path}`\n\n```yaml\n{Path(path).read_text(encoding='utf-8')}```"
