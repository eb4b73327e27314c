"""What the library raises when its input, not its code, is wrong."""

from collections.abc import Iterable
from difflib import get_close_matches

MAX_QUOTED_CHARACTERS = 60
"""Messages quote at most this many characters of an input."""


class InputError(Exception):
    """Bad input, described in one sentence: where it is (file, field), what is wrong, what would be right.

    The command line prints the sentence and ends with `exit_code`.

    >>> import unilateral as ul
    >>> try:
    ...     ul.solve("natural", h=1 / 16)
    ... except ul.InputError as error:
    ...     print(error)
    h and H are needed, and H is missing; if all data are formulas, ul.solve takes an accuracy instead
    """

    exit_code = 2


class BudgetError(InputError):
    """A limit was reached before there was any result.

    >>> import unilateral as ul
    >>> try:
    ...     ul.solve("natural", accuracy=0.01, max_seconds=1e-9)
    ... except ul.BudgetError as error:
    ...     print(error)
    max_seconds=1e-09 is not enough to solve on the coarsest mesh of 'square'
    """

    exit_code = 3


class SolutionWarning(UserWarning):
    """There is a solution, but it is not all that was asked for.

    The iteration did not converge, an accuracy was not reached, lambda_H may not be the only one, or a
    guaranteed bound takes more memory than is free. Each is also told by an attribute of the solution. Of a
    mesh it tells that nodes were moved onto sides because coordinates are rounded, or were left out.

    >>> import warnings
    >>> import unilateral as ul
    >>> with warnings.catch_warnings(record=True) as told:
    ...     warnings.simplefilter("always")
    ...     s = ul.solve("natural", h=1 / 8, H=1 / 8)
    >>> print(told[0].message)
    lambda_H may not be unique, because beta is 0 up to rounding; take h < H, such as H = 2h
    >>> s.unique
    False
    """


class IterationWarning(RuntimeWarning):
    """An iteration stopped above its tolerance."""


class StorageError(InputError):
    """A file that is damaged, or cannot be read or written, as on a full disk: no input is wrong."""

    exit_code = 4


def quote_input(value: object) -> str:
    """Input as a message quotes it: in one line, and its beginning if it is long."""
    text = " ".join(str(value).split(None)) if "\n" in str(value) else str(value)
    return text if len(text) <= MAX_QUOTED_CHARACTERS else f"{text[: MAX_QUOTED_CHARACTERS - 3]}..."


def suggest_name(name: str, known_names: Iterable[str]) -> str:
    """The end of a message about an unknown name: the known one that is most like it, if any is."""
    near = get_close_matches(name, known_names, n=1)
    return f"; did you mean {near[0]}?" if near else ""


def pluralise(n: int, singular: str, plural: str = "") -> str:
    """A number of things, such as 1 edge or 2 edges; `plural` is for words whose plural has no s at its end.

    >>> pluralise(1, "edge"), pluralise(2, "edge"), pluralise(1, "mesh", "meshes")
    ('1 edge', '2 edges', '1 mesh')
    """
    return f"{n} {singular if n == 1 else plural or singular + 's'}"
