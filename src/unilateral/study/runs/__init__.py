"""What the study computes: tables of errors, of beta, of costs, and of the extremes."""
