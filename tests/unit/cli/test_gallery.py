"""README's first screen and gallery: what its commands print and draw is what stands there."""

import base64
import io
import re

import numpy as np
import pytest
from conftest import ROOT
from documents import blocks
from matplotlib.image import imread

README = (ROOT / "README.md").read_text(encoding="utf-8")
COMMANDS = re.findall(r"unilateral (solve examples/(\w+)\.yaml --accuracy 0\.05) -o \2\.svg", README)
NUMBER = re.compile(r"\d+\.?\d*(?:e[+-]\d+)?")
GRID = 100
"""Places along each axis."""
PRINTED = 1e-2
"""Relative: on another processor a mesh may differ by a few triangles."""


def drawn(folder, run, name, accuracy="0.05"):
    """The picture of a problem."""
    path = folder / f"{name}_{accuracy}.svg"
    assert run("solve", str(ROOT / f"examples/{name}.yaml"), "--accuracy", accuracy, "-o", str(path))[0] == 0
    return path


def field(path):
    """u_h as it is drawn, at `GRID`² places: the first image in a picture. Its size depends on labels."""
    found = re.search(r"data:image/png;base64,\s*([^\"]+)", path.read_text(encoding="utf-8"))
    image = imread(io.BytesIO(base64.b64decode(found[1])))
    rows, columns = (np.linspace(0, n - 1, GRID).round().astype(int) for n in image.shape[:2])
    return image[np.ix_(rows, columns)]


def test_every_picture_of_an_example_has_its_command():
    shown = re.findall(r"examples/(\w+)\.svg", README)
    assert sorted(name for _, name in COMMANDS) == sorted(shown)
    assert sorted(shown) == sorted(path.stem for path in (ROOT / "examples").glob("*.yaml"))


@pytest.mark.parametrize("name", [name for _, name in COMMANDS])
def test_a_committed_picture_is_what_its_command_draws(tmp_path, run, name):
    """It differs from the one that is drawn now by much less than that does from one on a coarse mesh."""
    committed, now = field(ROOT / f"examples/{name}.svg"), field(drawn(tmp_path, run, name))
    coarse = field(drawn(tmp_path, run, name, "0.5"))
    assert np.abs(committed - now).mean() < 0.1 * np.abs(coarse - now).mean()


def test_the_first_command_prints_what_is_quoted(run):
    """The same words, and numbers nearly the same."""
    (quoted,) = (block.text for block in blocks("README.md") if block.kind == "text")
    code, printed, _ = run(*COMMANDS[0][0].replace("examples", str(ROOT / "examples")).split())
    assert code == 0
    for line in quoted.splitlines():
        words = NUMBER.sub("#", line)
        (same,) = [each for each in printed.splitlines() if NUMBER.sub("#", each) == words]
        numbers = [[float(number) for number in NUMBER.findall(each)] for each in (line, same)]
        assert numbers[0] == pytest.approx(numbers[1], rel=PRINTED)


def test_the_first_problem_is_the_one_that_is_quoted():
    (quoted,) = (block.text for block in blocks("README.md") if block.kind == "yaml")
    assert quoted == (ROOT / "examples/cog.yaml").read_text(encoding="utf-8")
