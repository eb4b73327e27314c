"""What the study concludes: rates, fits, and a verdict for every statement of the ledger."""
