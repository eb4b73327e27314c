"""The command `unilateral`."""

import sys

from unilateral.system.signals import leave_when_interrupted


def main() -> int:
    """Run it; the exit code. An interrupt ends it in one line from here on, also while it is imported."""
    leave_when_interrupted()
    from unilateral.cli import main as command

    return command()


if __name__ == "__main__":
    sys.exit(main())
