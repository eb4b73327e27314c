"""Problems whose f, g and q are the user's functions, known in points only: nothing is guaranteed."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from unilateral.arrays import Array, Index, nodal_values
from unilateral.errors import InputError
from unilateral.geometry.polygon import Polygon
from unilateral.problems.fields import as_html, as_text, fields_of, headed
from unilateral.problems.nodal import Nodal, NodalTraces
from unilateral.problems.units import Units

Function = Callable[[Array, Array], Array]
EACH = "it has to return a real number for each point"


@dataclass(frozen=True, eq=False)
class Sampled:
    """-k lap u + c u = f with contact, but k du/dn = q on `free_sides`; `units` come from k and c.

    `f` takes arrays x, y of one shape and returns that shape; so do the functions of `g` and `q`, one per
    side. On `clamped_sides` g is what u is there. If `q` is empty, the flux is 0. Arrays that are `nodal`
    take their place.
    """

    name: str
    polygon: Polygon
    f: Function
    g: tuple[Function, ...]
    free_sides: tuple[int, ...] = ()
    units: Units = field(default_factory=Units)
    q: tuple[Function, ...] = ()
    nodal: Nodal = field(default_factory=Nodal)
    clamped_sides: tuple[int, ...] = ()

    @property
    def reaction(self) -> float:
        return self.units.reaction

    @property
    def exact(self) -> None:
        """The solution of a problem with functions is not known."""

    @property
    def title(self) -> str:
        """No title is given with functions."""
        return ""

    def __repr__(self) -> str:
        return as_text(self)

    def _repr_html_(self) -> str:
        return as_html(headed(self), fields_of(self))

    def source(self, points: Array) -> Array:
        """f (...) at points (..., 2); raises InputError where it is no finite number."""
        return values(self.f, points, f"{self.name}, field f")

    def obstacle(self, side: Index, s: Array) -> Array:
        """g, or the given u, (k,) at arc lengths s (k,) of the sides (k,), 0 on free ones."""
        held = set(range(self.polygon.n_sides)) - {*self.free_sides}
        return self._on_sides({i: self.g[i] for i in held}, self.nodal.g, "g", side, s)

    def flux(self, side: Index, s: Array) -> Array:
        """q (k,) at arc lengths s (k,) of the sides (k,), 0 on those that are not free."""
        functions = {i: self.q[i] for i in self.free_sides if self.q}
        return self._on_sides(functions, self.nodal.q, "q", side, s)

    def place(self, field: str, side: int) -> str:
        """The place of g or q on a side, as messages name it; what stands in g on clamped sides is u."""
        named = "u" if field == "g" and side in self.clamped_sides else field
        return f"{self.name}, field {named}[{side}]"

    def _on_sides(
        self, functions: Mapping[int, Function], traces: NodalTraces, name: str, side: Index, s: Array
    ) -> Array:
        points, numbers = self.polygon.at(side, s), np.zeros(len(s))
        for i in np.intersect1d(side, [*functions]).astype(int).tolist():
            here = side == i
            if i in traces:
                numbers[here] = traces[i].at(s[here] / self.polygon.lengths[i])
            else:
                numbers[here] = values(functions[i], points[here], self.place(name, i))
        return numbers

    @property
    def kinks(self) -> Array:
        """(k,) the arc lengths of the nodes inside the sides where g is given by arrays."""
        starts, lengths = self.polygon.starts, self.polygon.lengths
        return np.concatenate([[], *(starts[i] + lengths[i] * of.cuts for i, of in self.nodal.g.items())])


def check_arguments(function: Function, where: str) -> None:
    """Raises InputError for a function that cannot be called with x and y."""
    try:
        signature = inspect.signature(function)
    except (TypeError, ValueError):  # of functions that are not written in Python
        return
    try:
        signature.bind(0.0, 0.0)
    except TypeError:
        raise InputError(
            f"{where}: the function takes the arguments {signature}; it has to take two, x and y, such as "
            "lambda x, y: x - y; of a function u of points write lambda x, y: u((x, y))"
        ) from None


def values(function: Function, points: Array, where: str) -> Array:
    """Values (...) at points (..., 2); raises InputError where the function fails or is no finite number."""
    x, y = np.array(points[..., 0]), np.array(points[..., 1])  # which a function may overwrite
    try:
        with np.errstate(all="ignore"):
            given = function(x, y)
    except InputError:
        raise
    except Exception as error:  # whatever a function of one's own may raise
        raise InputError(f"{where}: {_failed(function, points.reshape(-1, 2)[0], error)}") from error
    numbers = _numbers(given, points.shape[:-1], where)
    if not np.isfinite(numbers).all():
        at = np.unravel_index(np.argmin(np.isfinite(numbers)), numbers.shape)
        x, y = points[at]
        raise InputError(f"{where}: the function is {numbers[at]} at ({x:.6g}, {y:.6g})")
    return numbers


def _failed(function: Function, point: Array, error: Exception) -> str:
    """Why a function does not take arrays, and what to write; it may take one point at a time."""
    try:
        with np.errstate(all="ignore"):
            float(function(*point.tolist()))
    except Exception:  # as before
        return (
            f"the function failed ({type(error).__name__}: {error}); it has to take two arrays x and y and "
            "return numbers of their shape, such as lambda x, y: np.where(x > 1/2, 1.0, 0.0)"
        )
    return (
        f"the function takes one point at a time, and no arrays ({type(error).__name__}: {error}); write it "
        "with NumPy's functions, such as np.sin and np.where, or give np.vectorize(function, otypes=[float])"
    )


def _numbers(given: object, shape: tuple[int, ...], where: str) -> Array:
    """What a function returned as numbers of that shape; one number is that of all points."""
    numbers = nodal_values(given, f"{where}, value of the function", EACH)
    if numbers.size != 1 and numbers.shape != shape:
        raise InputError(
            f"{where}: the function returns an array of the shape {numbers.shape} for x and y of the shape "
            f"{shape}; {EACH}"
        )
    return np.broadcast_to(numbers, shape) if numbers.shape == shape else np.full(shape, numbers.item())
