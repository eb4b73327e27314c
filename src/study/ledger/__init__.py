"""Every statement of the paper as a claim, its check on the study's results, its control, and its verdict."""
