"""The norms of errors: H1 and L2 of a known solution, bounds of H^{-1/2}, and beta of (3.4)."""
