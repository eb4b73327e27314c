"""The pictures of docs/pictures, which pages show: each is drawn by what one of the pages types.

`make pictures` draws all of them anew, `python tests/pictures.py arch.svg` that one. Where a page types a
command that writes arch.html, arch.svg is the first plot in it.
"""

from __future__ import annotations

import base64
import io
import os
import re
import shutil
import sys
from collections.abc import Iterable
from pathlib import Path
from tempfile import TemporaryDirectory

import matplotlib as mpl
import numpy as np
from conftest import ROOT
from documents import PAGES, blocks
from matplotlib.image import imread
from reader import follow

FOLDER = ROOT / "docs/pictures"
SHOWN = re.compile(r"!\[[^\]]+\]\((?:docs/)?(?:\.\./)*pictures/([\w-]+\.svg)\)")
LABEL = re.compile(r"<!-- (.+?) -->")
IMAGE = re.compile(r"data:image/png;base64,\s*([^\"]+)")
THOUSANDS = re.compile(r"(?<=\d)\s(?=\d{3}\b)")
NUMBER = re.compile(r"\d+\.?\d*(?:e[+-]\d+)?")
GRID = 100
"""Places along each axis at which images are compared."""
PRINTED = 1e-2
"""Relative: on another processor a mesh may differ by a few triangles."""
SEEN = 2 / 256
"""A mean difference of two of the 256 steps of a colour is not seen."""


def list_pictures(page: str) -> list[str]:
    return SHOWN.findall((ROOT / page).read_text(encoding="utf-8"))


def typed_on(name: str) -> list[str]:
    """The pages whose blocks say that they write the picture, or the page of HTML that holds it."""
    written = re.compile(rf"(?<![\w.-]){Path(name).stem}\.(?:svg|html)\b")
    run = {page: "".join(block.text for block in blocks(page) if block.reason is None) for page in PAGES}
    return [page for page, text in run.items() if written.search(text)]


def read_picture(folder: Path, name: str) -> Path:
    """The picture in the folder in which a reader has followed its page."""
    picture = folder / name
    page = (folder / name).with_suffix(".html")
    if not picture.exists():
        _start, svg, remaining = page.read_text(encoding="utf-8").partition("<svg")
        picture.write_text(svg + remaining.partition("</svg>")[0] + "</svg>\n", encoding="utf-8")
    return picture


def alike(committed: Path, now: Path) -> bool:
    """Whether two pictures have the same labels, with nearly the same numbers, and nearly the same images."""
    texts = [path.read_text(encoding="utf-8") for path in (committed, now)]
    labels = [[THOUSANDS.sub("", label) for label in LABEL.findall(text)] for text in texts]
    words = [[NUMBER.sub("#", label) for label in item] for item in labels]
    numbers = [np.array(NUMBER.findall(" ".join(label)), dtype=float) for label in labels]
    images = [[field(image) for image in IMAGE.findall(text)] for text in texts]
    return (
        words[0] == words[1]
        and np.allclose(*numbers, rtol=PRINTED, atol=0)
        and len(images[0]) == len(images[1])
        and all(np.abs(a - b).mean() <= SEEN for a, b in zip(*images, strict=True))
    )


def field(image: str) -> np.ndarray:
    """The colours at `GRID`² places of an image in an SVG; its size depends on labels."""
    pixels = imread(io.BytesIO(base64.b64decode(image)))
    height, width = pixels.shape[:2]
    rows = np.linspace(0, height - 1, GRID).round().astype(int)
    columns = np.linspace(0, width - 1, GRID).round().astype(int)
    return pixels[np.ix_(rows, columns)]


def draw(names: Iterable[str]) -> None:
    """Writes these pictures into docs/pictures."""
    makers = {name: typed_on(name)[0] for name in names}
    for page in sorted(set(makers.values())):
        with TemporaryDirectory() as folder, mpl.rc_context({"svg.hashsalt": "unilateral"}):
            follow(blocks(page), Path(folder))
            for name in (name for name, maker in makers.items() if maker == page):
                shutil.copy(read_picture(Path(folder), name), FOLDER / name)
                print(f"docs/pictures/{name}, by {page}")


if __name__ == "__main__":
    os.environ["SOURCE_DATE_EPOCH"] = "0"  # matplotlib then writes the same bytes each time
    draw(sys.argv[1:] or sorted({name for page in PAGES for name in list_pictures(page)}))
