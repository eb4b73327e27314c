"""Verification of the mixed finite element method of Haslinger and Lovíšek (1980) for unilateral problems.

The modules, in the order in which data flows: polygon, partition, mesh; expression, atoms, polar, case,
certificate, problem; quadrature, forms, coupling, condense; uzawa, active_set, solve; norms, bounds,
accuracy; rates, tables, plots, cli.
"""


def __getattr__(name: str) -> str:
    """The version, looked up when it is asked for, for that takes longer than all other imports of `cli`."""
    if name != "__version__":
        raise AttributeError(f"module 'unilateral' has no attribute '{name}'")
    from importlib.metadata import version

    return version("unilateral")
