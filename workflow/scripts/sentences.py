"""How a script ends on bad input: with one sentence instead of a traceback."""

import sys

from unilateral.errors import InputError


def speak_plainly():
    """Let an InputError end this process with its sentence; any other error keeps its traceback."""

    def tell(kind, error, trace):
        if issubclass(kind, InputError):
            print(f"unilateral: {error}", file=sys.stderr)
        else:
            sys.__excepthook__(kind, error, trace)

    sys.excepthook = tell
