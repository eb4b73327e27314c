"""The verification study: its configuration, its runs, their judgement, its figures and its texts."""
