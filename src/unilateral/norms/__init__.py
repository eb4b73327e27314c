"""The norms of errors: H1 and L2 norms for a known solution, bounds on H^{-1/2} norms, and beta of (3.4)."""
