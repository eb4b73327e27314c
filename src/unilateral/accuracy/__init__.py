"""A stated accuracy, certified: levels from coarse to fine until the guaranteed bound is small enough."""
