"""Problems made to fool a certificate, each told by its family and its number.

Peaks, waves and kinks of f that rules do not see, obstacles that touch u in points, numbers that cancel.
"""

import numpy as np
import sympy
from known_solutions import Feature, Known, KnownSolution, fluxes
from symbolic import X, Y, plain, pos

from unilateral.adaptive.goal import Goal
from unilateral.adaptive.loop import search
from unilateral.formulas.expression import ZERO
from unilateral.formulas.formula import parse_formula
from unilateral.geometry.polygon import Polygon
from unilateral.problems.atoms import laplacian
from unilateral.problems.problem import Problem

MOST = 400
"""Unknowns on the finest mesh."""


def adversary(u, gap=0, features=(), free=(), shift=0, spoil="0", with_fluxes=False):
    """u with g = u - gap on the unit square moved by `shift`; `features` of u and g.

    `spoil` is a formula that is 0, added to f. On `free` sides du/dn is 0, or it is given there.
    """
    square = Polygon(np.array([(shift, 0), (shift + 1, 0), (shift + 1, 1), (shift, 1)]), "adversary")
    f = plain(u) - laplacian(plain(u), "x", "y") + parse_formula(spoil, ("x", "y"), "spoil")
    g = (plain(u - gap),) * 4
    q = ()
    if with_fluxes:
        du_dn = fluxes(u, square.vertices)
        q = tuple(plain(du_dn[side]) if side in free else ZERO for side in range(4))
    return Known(Problem(square.name, square, f, g, tuple(free), q=q), u, tuple(features))


def make_adversarial_problem(family, number):
    return FAMILIES[family](np.random.default_rng([number, *family.encode()]))


def try_family(family, number):
    """A problem with the solutions of a search's levels."""
    known_case = make_adversarial_problem(family, number)
    solved_levels = [
        level.solved for level in search(known_case.problem, Goal(0.02, max_unknowns=MOST)).levels
    ]
    return KnownSolution(known_case, [(solved, [(solved.u_h, solved.lambda_H)]) for solved in solved_levels])


def exact(number):
    return sympy.Rational(round(number * 10**6), 10**6)


def bowl(rng, shift=0):
    """k |x - c|^2/2, whose flux is at least k/4 on the unit square."""
    c = rng.uniform(0.3, 0.7, 2)
    a = exact(c[0])
    b = exact(c[1])
    return 4 * ((X - a - shift) ** 2 + (Y - b) ** 2) / 2


def peak(rng, place, logarithm=(-3, -1)):
    """A Gaussian inside, on a side or at a vertex, as high as the bowl's flux allows, and its feature."""
    width = 10.0 ** rng.uniform(*logarithm)
    inner = rng.uniform(0.15, 0.85, 2)
    position = {"inside": inner, "side": np.array([inner[0], 0.0]), "vertex": np.array([1.0, 1.0])}[place]
    if place == "inside":
        width = min(width, 0.15 * np.min([inner, 1 - inner]))
    height = width * (20.0 if place == "inside" else 0.5)
    a = exact(position[0])
    b = exact(position[1])
    w = exact(width)
    bump = exact(height) * sympy.exp(-((X - a) ** 2 + (Y - b) ** 2) / w**2)
    return bump, Feature(sympy.sqrt((X - a) ** 2 + (Y - b) ** 2), float(w))


def peaks(rng):
    """Full contact, one to three narrow peaks of f, inside, on a side, at a vertex."""
    places = rng.choice(["inside", "side", "vertex"], rng.integers(1, 4))
    peaks = [peak(rng, place) for place in places]
    return adversary(bowl(rng) + sum(bump for bump, _ in peaks), features=[feature for _, feature in peaks])


def waves(rng):
    """Full contact; waves of 2^k pi, with which meshes and rules alias, in x, y or across."""
    k = 2 ** int(rng.integers(2, 6)) * int(rng.choice([1, 3, 5]))
    phase = [X, Y, X + Y, X - Y][rng.integers(4)]
    wave = sympy.cos(k * sympy.pi * phase) / (2 * k * sympy.pi)
    return adversary(bowl(rng) + wave, features=[Feature(sympy.S.Zero * X, 1.0 / k)])


def kinks(rng):
    """Full contact; f jumps or has a kink along a line or a circle off the mesh, or through its nodes."""
    power = int(rng.integers(2, 4))
    height = exact(rng.uniform(-1, 1))
    if rng.random() < 0.5:
        angle = rng.uniform(0, np.pi)
        c = rng.uniform(0.3, 0.7)
        a = exact(np.cos(angle))
        b = exact(np.sin(angle))
        level = a * X + b * Y - exact(c) if rng.random() < 0.7 else X - Y
        smaller = sympy.Rational(1, 2)
    else:
        x = exact(rng.uniform(0.3, 0.7))
        y = exact(rng.uniform(0.3, 0.7))
        r = exact(rng.uniform(0.02, 0.28))
        level = r - ((X - x) ** 2 + (Y - y) ** 2) / r
        smaller = sympy.Rational(1, 4)
    u = bowl(rng) + smaller * height * pos(level, power)
    return adversary(u, features=[Feature(level, 8e-3)])


def sides(rng):
    """u depends on x only, so the flux is 0 below and above, where g touches u in points or oscillates."""
    c = exact(rng.uniform(0.35, 0.65))
    k = int(rng.integers(3, 400))
    u = 4 * (X - c) ** 2 / 2
    a = exact(rng.uniform(0.1, 0.9))
    w = exact(10.0 ** rng.uniform(-4, -1))
    gap = [
        1 - sympy.exp(-((X - a) ** 2) / w**2),
        sympy.sin(k * sympy.pi * X) ** 2 / 3,
        pos(X - a, 1) * 50 + pos(a - X, sympy.Rational(3, 2)),
        (X - a) ** 2 * 1000,
    ][rng.integers(4)]
    on_sides = gap * X * (1 - X) * 4
    return adversary(u, on_sides)


def large(rng):
    """Differences of large numbers: far from the origin, expanded, and with terms that cancel."""
    shift = int(rng.choice([0, 10, 100, 1000]))
    u = sympy.expand(bowl(rng, shift) + (X - shift) ** 3 / 20)
    c = 10 ** int(rng.integers(2, 8))
    spoil = f"{c}*(x - y)**2 - {c}*x**2 + {2 * c}*x*y - {c}*y**2"
    return adversary(u, shift=shift, spoil=spoil)


def neumann(rng):
    """No contact: peaks of f inside, the flux 0 but for 1e-10; free sides beside others far below."""
    bump, feature = peak(rng, "inside", (-2.5, -1.2))
    free = tuple(rng.choice(4, 2, replace=False).tolist())
    return adversary(1 + bump, 3, [feature], sorted(free))._replace(doubt=1e-9)


def given_fluxes(rng):
    """Given fluxes of any sign beside contact: steep from a peak at side 0, or waves with which edges alias.

    A wave that falls like exp(-w y) has no flux through the sides beside; on the others the bowl's outweighs.
    """
    free = (0, *sorted(rng.choice([1, 2, 3], rng.integers(0, 3), replace=False).tolist()))
    if rng.random() < 0.5:
        width = 10.0 ** rng.uniform(-2.5, -1.3)
        a = exact(rng.uniform(0.35, 0.65))
        b = exact(width * rng.uniform(-1.5, 1.5))
        height = exact(width * rng.choice([-1, 1]) * 10.0 ** rng.uniform(-1, 2))
        square = (X - a) ** 2 + (Y - b) ** 2
        w = exact(width)
        extra = height * sympy.exp(-square / w**2)
        feature = Feature(sympy.sqrt(square), float(w))
    else:
        k = 2 ** int(rng.integers(2, 6)) * int(rng.choice([1, 3, 5]))
        height = exact(rng.choice([-1, 1]) * 10.0 ** rng.uniform(-1, 1))
        extra = height / k * sympy.cos(k * sympy.pi * X) * sympy.exp(-k * sympy.pi * Y)
        feature = Feature(Y, 1.0 / k)
    return adversary(bowl(rng) + extra, features=[feature], free=free, with_fluxes=True)


FAMILIES = {family.__name__: family for family in (peaks, waves, kinks, sides, large, neumann)} | {
    "fluxes": given_fluxes
}
COUNTS = {"peaks": 10, "waves": 8, "kinks": 10, "sides": 10, "large": 6, "neumann": 6, "fluxes": 10}
"""How many of each the suite tries."""
