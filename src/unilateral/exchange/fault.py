"""What is wrong with a solution, in words."""

from __future__ import annotations

from typing import NamedTuple

UNEXPLAINED = "no known bug explains it"


class Fault(NamedTuple):
    """`what` is wrong, the same on every level, and what was `measured` on this one.

    It is `explained` if it is a bug that is known.
    """

    what: str
    measured: str
    explained: bool = True

    def __str__(self) -> str:
        return f"{self.what}: {self.measured}"


def wrong(name: str, factor: float, right: str = "the right one") -> Fault:
    """The fault that something has a wrong factor; `right` says what it is a multiple of."""
    return Fault(f"{name} has the wrong {'sign' if factor < 0 else 'scale'}", f"{factor:.6g} times {right}")


def unexplained(what: str, perhaps: str, measured: str) -> Fault:
    """The fault that something is wrong, and what may be the reason; "" if there is no guess."""
    guess = f" (perhaps {perhaps})" if perhaps else ""
    return Fault(f"{what}, and {UNEXPLAINED}{guess}", measured, explained=False)


def either(faults: list[Fault]) -> Fault:
    """One of several faults, where nothing tells which."""
    what = "; or ".join(dict.fromkeys(fault.what for fault in faults))
    measured = "; or ".join(dict.fromkeys(fault.measured for fault in faults))
    return Fault(what, measured, all(fault.explained for fault in faults))
