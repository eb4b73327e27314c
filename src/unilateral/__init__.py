"""Verification of the mixed finite element method of Haslinger and Lovíšek (1980) for unilateral problems.

The method: `geometry`, `formulas`, `problems`, `fem`, `solvers`, `norms`, `bounds`, and on them `solve`, `discrete` and
`accuracy`. The `study` uses the method, never the other way. `cli` is the command line.
"""


def __getattr__(name: str) -> str:
    """The version, looked up when it is asked for, for that takes longer than all other imports of `cli`."""
    if name != "__version__":
        raise AttributeError(f"module 'unilateral' has no attribute '{name}'")
    from importlib.metadata import version

    return version("unilateral")
