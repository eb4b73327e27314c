"""The command line `unilateral`, by click; `guard` is what the project adds to it."""

from unilateral.cli.guard import main

__all__ = ["main"]
