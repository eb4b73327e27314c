"""Solvers: Uzawa's algorithm (5.1)-(5.3), its faster steps, an active set, and multigrid."""
