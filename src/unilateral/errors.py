"""What the library raises when its input, not its code, is wrong."""

LONGEST = 60


class InputError(Exception):
    """Bad input, told in one sentence: where (file, field), what is wrong, what would be right.

    The command line prints the sentence and ends with exit code 2.
    """


def shown(value: object) -> str:
    """Input as a message quotes it: its beginning, if it is long."""
    text = str(value)
    return text if len(text) <= LONGEST else f"{text[: LONGEST - 3]}..."
