"""What is wrong with a solution, in words."""

from __future__ import annotations

from typing import NamedTuple

UNEXPLAINED = "no known bug explains it"


class Fault(NamedTuple):
    """A fault: its `description`, the same on every level, and a `detail` that was measured on this one.

    It is `is_explained` if it is a bug that is known.
    """

    description: str
    detail: str
    is_explained: bool = True

    def __str__(self) -> str:
        return f"{self.description}: {self.detail}"


def describe_wrong_factor(name: str, factor: float, expected: str = "the right one") -> Fault:
    """The fault that something has a wrong factor; `expected` says what it is a multiple of."""
    return Fault(
        f"{name} has the wrong {'sign' if factor < 0 else 'scale'}", f"{factor:.6g} times {expected}"
    )


def describe_unknown_fault(description: str, reason: str, detail: str) -> Fault:
    """The fault that something is wrong, and what may be the reason; "" if there is no guess."""
    guess = f" (perhaps {reason})" if reason else ""
    return Fault(f"{description}, and {UNEXPLAINED}{guess}", detail, is_explained=False)


def merge_alternatives(faults: list[Fault]) -> Fault:
    """One fault whose description and detail are those of several, joined by "or"."""
    description = "; or ".join(dict.fromkeys(fault.description for fault in faults))
    detail = "; or ".join(dict.fromkeys(fault.detail for fault in faults))
    return Fault(description, detail, all(fault.is_explained for fault in faults))
