"""A stated accuracy, certified: solve, bound, mark and refine until the guaranteed bound is small enough."""
