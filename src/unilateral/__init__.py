"""Verification of the mixed finite element method of Haslinger and Lovíšek (1980) for unilateral problems.

The modules, in the order in which data flows: polygon, partition, mesh; expression, atoms, polar, case,
certificate, problem; quadrature, forms, coupling, condense; uzawa, active_set, solve; norms, bounds,
accuracy; rates, tables, plots, cli.
"""

from importlib.metadata import version

__version__ = version("unilateral")
