"""Polygons from files: the same as from a list of their vertices, and files that are refused."""

import numpy as np
import pytest
import sentences

import unilateral as ul
from unilateral.errors import InputError

VERTICES = [(0, 0), (2, 0), (2, 1), (1, 1.5), (0, 1 / 3)]
ROWS = "0,0\n2,0\n2,1\n1,1.5\n0,0.3333333333333333\n"


def write_problem(folder, text):
    (folder / "part.csv").write_text(text)
    file = folder / "own.yaml"
    file.write_text("polygon: part.csv\nf: 3*x - 5\ng: {0: x*(2 - x), 1: 0}\nfree_sides: [2, 3, 4]\n")
    return file


@pytest.mark.parametrize("text", [ROWS, "x,y\n" + ROWS, ROWS + "0,0\n", ROWS.replace(",", ";")])
def test_vertices_in_a_file_are_those_of_a_list(tmp_path, text):
    """With a heading, a closing row or another separator, too; bit for bit."""
    from_list = ul.Problem(VERTICES, "3*x - 5", ["x*(2 - x)", 0, None, None, None], [2, 3, 4])
    file = write_problem(tmp_path, text)
    from_python = ul.Problem(
        polygon=tmp_path / "part.csv", f="3*x - 5", g={0: "x*(2 - x)", 1: 0}, free_sides=[2, 3, 4]
    )
    for problem in (ul.load(file), from_python):
        np.testing.assert_array_equal(problem.polygon.vertices, from_list.polygon.vertices)
        solution = ul.solve(problem, h=1 / 4, H=1 / 2)
        assert solution.bounds == ul.solve(from_list, h=1 / 4, H=1 / 2).bounds


@pytest.mark.parametrize(
    ("text", "place"),
    [
        ("0,0\n1,0\n", "part.csv"),
        ("0,0\n1,0\n0,0\n", "part.csv"),
        ("", "part.csv"),
        ("0,0\n1,0\n1,a\n", "line 3"),
        ("0;0\n1,5;0\n1;1\n", "line 2"),
        ("0,0,0\n1,0,0\n1,1,0\n", "line 1"),
        ("x,y\n0,0\n1,1\n1,0\n0,1\n", "line 2"),
        ("0,0\n0,1\n1,1\n", "clockwise"),
        ("0,0\n1,0\n1,0\n1,1\n", "repeats"),
        ("0,0\n1e999,0\n1,1\n", "finite"),
        ("\n".join(f"{i},{i * i}" for i in range(1001)), "1001"),
    ],
)
def test_a_file_of_no_polygon_is_refused(tmp_path, text, place):
    with sentences.raises(InputError, "part.csv", place):
        ul.load(write_problem(tmp_path, text))


def test_a_file_that_is_not_there_is_named_with_the_field(tmp_path):
    file = write_problem(tmp_path, ROWS)
    (tmp_path / "part.csv").unlink()
    with sentences.raises(InputError, "own.yaml, field polygon", "part.csv"):
        ul.load(file)
    with sentences.raises(InputError, "field polygon"):
        ul.Problem(polygon="square", f=-1, g=0)
