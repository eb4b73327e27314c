"""The command `unilateral`."""

import sys

from unilateral.system.signals import exit_on_interrupt


def main() -> int:
    """Run it; the exit code. An interrupt ends it in one line from here on, also while it is imported."""
    exit_on_interrupt()
    from unilateral.cli import main as command

    return command()


if __name__ == "__main__":
    sys.exit(main())
