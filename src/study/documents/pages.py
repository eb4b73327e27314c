"""The report's pages: texts with marks, filled in and typeset.

They also show what the results were made with: versions, files by rule, and parameters.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from study.documents import marks, verdicts
from study.documents.numbers import format_markdown
from study.documents.typesetting import convert_to_page, convert_to_restructured_text
from study.ledger import records
from unilateral.system.files import replacing

BYTES_PER_MEGABYTE = 1e6


def typeset_pages(
    numbers: str,
    blocks: str,
    claims: str,
    manifest: str,
    parameters: Sequence[str],
    texts: Sequence[str],
    front_text: str,
    filter: str,
    template: str,
    pages: Sequence[str],
    front_page: str,
) -> None:
    """Write a page for each text, and the front page; `filter` is a Lua filter for pandoc."""
    all_blocks = records.read_records(blocks) | provenance_blocks(records.read_records(manifest), parameters)
    holding = verdicts.holds_by_claim(records.read_records(claims))
    for text, page in zip(texts, pages, strict=True):
        filled = marks.fill_text(text, records.read_records(numbers), all_blocks, holding)
        with replacing(page) as temporary:
            temporary.write_text(convert_to_page(filled, text, filter, template), encoding="utf-8")
    front = marks.fill_text(front_text, records.read_records(numbers), all_blocks, holding)
    with replacing(front_page) as temporary:
        temporary.write_text(convert_to_restructured_text(front), encoding="utf-8")


def provenance_blocks(manifest: Mapping[str, Any], parameters: Iterable[str]) -> dict[str, str]:
    """Blocks by their names, from the study's manifest and the files that hold its parameters."""
    versions = pd.DataFrame(manifest["versions"].items(), columns=["package", "version"])
    # How many files each rule made, and how large they are
    sizes = pd.DataFrame(manifest["files"]).groupby("rule", sort=False)["bytes"]
    megabytes = sizes.sum().map(lambda size: f"{size / BYTES_PER_MEGABYTE:.2g}")
    files = pd.DataFrame({"files": sizes.size().astype(str), "MB": megabytes}).reset_index()
    texts = [f"SHA-256 of the configuration: `{manifest['parameters']}`"]
    texts += [f"## `{path}`\n\n```yaml\n{Path(path).read_text(encoding='utf-8')}```" for path in parameters]
    return {
        "versions": format_markdown(versions),
        "files": format_markdown(files),
        "parameters": "\n\n".join(texts),
    }
