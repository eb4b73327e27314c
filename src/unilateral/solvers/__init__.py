"""Solvers of the condensed problem: Uzawa's algorithm (5.1)-(5.3), its faster steps, and an active set."""
