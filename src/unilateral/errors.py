"""What the library raises when its input, not its code, is wrong."""


class InputError(Exception):
    """Bad input, told in one sentence: where (file, field), what is wrong, what would be right.

    The command line prints the sentence and ends with exit code 2.
    """
