"""The problems that tests of accuracies solve."""

from conftest import DATA, load

from unilateral.problems import problem_file

FILES = sorted((DATA / "problems").glob("*.yaml"))
"""Problems without a known solution."""


def problem(name):
    """What one of these files declares, or a case on the square or, if it is for that, on the L-shape."""
    if name.endswith(".yaml"):
        return problem_file.load(str(DATA / "problems" / name))
    return load(name, "lshape" if name in ("reentrant", "violates_j") else "square").problem
