"""The problems that tests of accuracies solve, and the levels of a search."""

from functools import cache

from conftest import DATA, load

from unilateral.adaptive.loop import search
from unilateral.problems import problem_file

FILES = sorted((DATA / "problems").glob("*.yaml"))
"""Problems without a known solution."""


@cache
def problem(name):
    """What one of these files declares, or a case on the square or, if it is for that, on the L-shape."""
    if name.endswith(".yaml"):
        return problem_file.load_problem(str(DATA / "problems" / name))
    return load(name, "lshape" if name in ("reentrant", "violates_j") else "square").problem


def levels(problem, goal):
    return search(problem, goal).levels


def first_level(problem, goal):
    """The first level alone: an interrupt ends the search after it."""

    def interrupt(_):
        raise KeyboardInterrupt

    (only,) = search(problem, goal, interrupt).levels
    return only
