"""The code blocks of the documents in Markdown."""

from __future__ import annotations

import re
from typing import NamedTuple

from conftest import ROOT

BLOCK = re.compile(
    r"""(?:^\ *<!--\ not\ run:\ (?P<reason>[^\n]+)\ -->\n)?
        ^(?P<indent>\ *)```(?P<kind>[^\n]*)\n(?P<text>.*?)^(?P=indent)```$""",
    re.MULTILINE | re.DOTALL | re.VERBOSE,
)
PAGES = sorted(
    str(file.relative_to(ROOT))
    for pattern in ("README.md", "CONTRIBUTING.md", "docs/*.md", "manufactured/*.md", "benchmarks/*.md")
    for file in ROOT.glob(pattern)
)


class Block(NamedTuple):
    """`kind` is what stands behind the ticks; `reason` is why it is not run, if it is marked so."""

    page: str
    line: int
    kind: str
    text: str
    reason: str | None


def blocks(page: str) -> list[Block]:
    """Those of a page, but for Sphinx's directives."""
    return blocks_in((ROOT / page).read_text(encoding="utf-8"), page)


def blocks_in(text: str, page: str = "") -> list[Block]:
    blocks = (block(text, page, match) for match in BLOCK.finditer(text))
    return [block for block in blocks if not block.kind.startswith("{")]


def block(text: str, page: str, match: re.Match[str]) -> Block:
    """With the line of its first ticks, and without the spaces before these, as in a list."""
    line = text.count("\n", 0, match.start("kind")) + 1
    inside = re.sub(f"^{match['indent']}", "", match["text"], flags=re.MULTILINE)
    return Block(page, line, match["kind"], inside, match["reason"])
