"""The command `unilateral`. An interrupt ends it in one line from here on, also while it is imported."""

import sys

from unilateral.signals import leave_when_interrupted

leave_when_interrupted()

from unilateral.cli import main  # noqa: E402

if __name__ == "__main__":
    sys.exit(main())
