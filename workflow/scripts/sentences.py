"""How a script ends on bad input or a bad file: with one sentence instead of a traceback."""

import sys

from unilateral.errors import InputError


def speak_plainly():
    """Let an InputError end this process with its sentence and exit code; other errors keep tracebacks."""

    def tell(kind, error, trace):
        if issubclass(kind, InputError):
            print(f"unilateral: {error}", file=sys.stderr)
            sys.exit(error.exit_code)
        sys.__excepthook__(kind, error, trace)

    sys.excepthook = tell
