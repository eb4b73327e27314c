"""What a user holds: the solution, its certificate, contact set, values, tables and picture."""

from unilateral.solution.solution import Solution

__all__ = ["Solution"]
