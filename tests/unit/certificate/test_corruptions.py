"""500 corrupted certificates: each is refused, or its bound is not below the true error of the corrupted v.

u is known, a polynomial, and so the error is known for whatever v and mesh the corrupted file has. Where a
corruption hits the stated problem, the checker has to print another problem.

Corruptions at random seldom hit two places that would make a lie together. Of the checkers that
test_mutants_of_the_checker.py spoils, they expose four. So that file attacks each part on its own.
"""

import gzip
import json
import math
import random
import sys
from collections import Counter
from decimal import Decimal
from fractions import Fraction
from itertools import pairwise

import pytest
from known_certificates import (
    certificate,
    checker,
    derivative,
    edge_values,
    fan,
    nodes,
    polynomial,
    true_error,
    value,
)
from test_mutants_of_the_checker import ATTACKS

SQUARE = [(0, 0), (1, 0), (1, 1), (0, 1)]
PENTAGON = [(0, 0), (2, 0), (2, 1), (1, Fraction(3, 2)), (Fraction(-1, 3), Fraction(4, 5))]
BOWL = polynomial(one="17/64", x="-3/8", y="-5/8", xx="1/2", yy="1/2")
"""((x - 3/8)^2 + (y - 5/8)^2) / 2, whose normal derivative is positive on polygons around (3/8, 5/8)."""
COUNT = 500
ROUNDING = 1e-9
"""Of the true error: its quadrature is exact otherwise, and u - v loses some six digits of sixteen."""
PRINTED = "PROVED: |||u - v||| <= "
HARMONIC = [polynomial(one=1), polynomial(x=1), polynomial(y=1), polynomial(xy=1), polynomial(xx=1, yy=-1)]
VALUES = [None, True, "1", "x", "1/0", "", [], {}, [[0]], -1, 0, 7, 0.5, 1e30, -1e30, 10**30, 5e-324]
VALUES += [float("nan"), float("inf"), "\ud800", "9" * 401, [None] * 3, {"contact": []}]


def interpolate_certificate(u, k):
    """v = u at nodes, p = k grad u, and v + y = u + 1e-12, so that v + y >= g in spite of rounding."""
    slopes = derivative(u, 0), derivative(u, 1)
    return {
        "v": lambda x, y: value(u, x, y),
        "p": lambda x, y: tuple(Fraction(k) * value(slope, x, y) for slope in slopes),
        "trace": lambda x, y: value(u, x, y) + Fraction(1, 10**12),
    }


def full_contact():
    """g = u on the whole boundary of the square."""
    sides = [("contact", BOWL)] * 4
    load = [*BOWL, *polynomial(one=-2)]
    mesh = fan(SQUARE, (Fraction(3, 8), Fraction(1, 2)), 3)
    return certificate(SQUARE, sides, load, c=1, **mesh, **interpolate_certificate(BOWL, 1)), BOWL


def gaps():
    """u = x^2 touches g at x = 1, and is 1 above it on the other sides, where du/dn = 0; k = 2, c = 1/3."""
    u = polynomial(xx=1)
    below = polynomial(xx=1, one=-1)
    sides = [("contact", below), ("contact", u), ("contact", below), ("contact", below)]
    mesh = fan(SQUARE, (Fraction(1, 2), Fraction(5, 8)), 3)
    load = polynomial(one=-4, xx="1/3")
    return certificate(SQUARE, sides, load, k=2, c=Fraction(1, 3), **mesh, **interpolate_certificate(u, 2)), u


def clamped_and_free():
    """u = x + x y/2 + x^3/6, c = 0: clamped at x = 0, contact at x = 1, free sides with t = -x/2, x/2."""
    sides = [
        ("free", polynomial(x="-1/2")),
        ("contact", polynomial(one="7/6", y="1/2")),
        ("free", polynomial(x="1/2")),
        ("clamped", polynomial()),
    ]
    u = polynomial(x=1, xy="1/2", xxx="1/6")
    mesh = fan(SQUARE, (Fraction(5, 8), Fraction(1, 2)), 3)

    def field(x, y):
        return Fraction(5, 4) * (x - 1), 0

    return certificate(
        SQUARE, sides, polynomial(x=-1), field=field, **mesh, **interpolate_certificate(u, 1)
    ), u


def make_slanted_certificate():
    """g = u on the whole boundary of a pentagon with slanted sides; k = 1/2, c = 3."""
    load = [[i, j, str(3 * Fraction(c))] for i, j, c in BOWL] + polynomial(one=-1)
    mesh = fan(PENTAGON, (Fraction(3, 4), Fraction(5, 8)), 3)
    sides = [("contact", BOWL)] * 5
    return certificate(
        PENTAGON, sides, load, k=Fraction(1, 2), c=3, **mesh, **interpolate_certificate(BOWL, Fraction(1, 2))
    ), BOWL


PROBLEMS = [full_contact, gaps, clamped_and_free, make_slanted_certificate]


# ---- Corruptions: each changes the certificate in place ----


def place_in(values, rng):
    return rng.randrange(len(values))


def size(rng):
    return rng.choice([-1, 1]) * rng.choice([1e-12, 1e-6, 1e-3, 0.1, 1, 100])


def change_values(name, count):
    def change(stated, rng):
        for _ in range(count):
            stated[name][place_in(stated[name], rng)] += size(rng)

    return change


def multiply(name):
    def change(stated, rng):
        factor = rng.choice([0.5, -1, 0, 2, 1.001, 0.999, 1e-3, 1e3])
        stated[name] = [factor * z for z in stated[name]]

    return change


def shift(name):
    def change(stated, rng):
        amount = size(rng)
        stated[name] = [z + amount for z in stated[name]]

    return change


def shuffle(name):
    def change(stated, rng):
        rng.shuffle(stated[name])

    return change


def exchange_values(name):
    def change(stated, rng):
        i = place_in(stated[name], rng)
        j = place_in(stated[name], rng)
        stated[name][i], stated[name][j] = stated[name][j], stated[name][i]

    return change


def change_length(name):
    def change(stated, rng):
        if rng.random() < 0.5:
            stated[name].pop(place_in(stated[name], rng))
        else:
            stated[name].insert(place_in(stated[name], rng), rng.choice(stated[name]))

    return change


def add_function(stated, rng):
    """A harmonic w is added to some of v and v + y, and k grad w to p. With all three, f + c w is solved."""
    w = rng.choice(HARMONIC)
    amount = Fraction(size(rng))
    points = nodes(stated)
    slopes = derivative(w, 0), derivative(w, 1)
    k = Fraction(stated["problem"]["k"])
    rim = points[: len(stated["trace"]) // 2]
    middles = [tuple((a + b) / 2 for a, b in zip(*ends, strict=True)) for ends in pairwise([*rim, rim[0]])]
    added = {
        "v": [value(w, *point) for point in points],
        "trace": [value(w, *point) for point in rim + middles],
        "flux": edge_values(
            stated["mesh"]["triangles"], points, lambda x, y: [k * value(slope, x, y) for slope in slopes]
        ),
    }
    for name in rng.choice(
        [["v"], ["trace"], ["flux"], ["v", "trace"], ["v", "flux"], list(added), list(added)]
    ):
        stated[name] = [
            float(old + amount * Fraction(new)) for old, new in zip(stated[name], added[name], strict=True)
        ]


def move_node(stated, rng):
    inside = stated["mesh"]["inside"]
    inside[place_in(inside, rng)][rng.randrange(2)] += rng.choice([-1, 1]) * rng.choice(
        [1e-9, 0.01, 0.05, 0.3]
    )


def exchange_nodes(stated, rng):
    exchange_values("inside")(stated["mesh"], rng)


def move_boundary_node(stated, rng):
    places = rng.choice(stated["mesh"]["boundary"])
    places[place_in(places, rng)] += rng.choice([-1, 1]) * rng.choice([1e-9, 0.05, 0.3])


def omit_boundary_node(stated, rng):
    places = rng.choice(stated["mesh"]["boundary"])
    places.pop(place_in(places, rng))


def add_boundary_node(stated, rng):
    places = rng.choice(stated["mesh"]["boundary"])
    places.append(0.5 * (1 + places[-1]))


def turn_triangle(stated, rng):
    rng.choice(stated["mesh"]["triangles"]).reverse()


def rotate_triangle(stated, rng):
    """The same triangle, whose edges are mentioned in another order, so that flux values are exchanged."""
    triangle = rng.choice(stated["mesh"]["triangles"])
    triangle.append(triangle.pop(0))


def flip_edge(stated, rng):
    """A quadrilateral is cut along its other diagonal; some of these meshes are correct."""
    triangles = stated["mesh"]["triangles"]
    a, b, c = rng.choice(triangles)
    for triangle in triangles:
        for i in range(3):
            if triangle[i] == c and triangle[(i + 1) % 3] == b:
                d = triangle[(i + 2) % 3]
                triangle[:] = [a, d, c]
                triangles[triangles.index([a, b, c])] = [a, b, d]
                return


def change_corner(stated, rng):
    rng.choice(stated["mesh"]["triangles"])[rng.randrange(3)] = place_in(stated["v"], rng)


def omit_triangle(stated, rng):
    stated["mesh"]["triangles"].pop(place_in(stated["mesh"]["triangles"], rng))


def double_triangle(stated, rng):
    stated["mesh"]["triangles"].append(list(rng.choice(stated["mesh"]["triangles"])))


def overlap(stated, rng):
    stated["mesh"]["triangles"].append(rng.sample(range(len(stated["v"])), 3))


def make_hole(stated, rng):
    node = rng.randrange(sum(map(len, stated["mesh"]["boundary"])), len(stated["v"]))
    triangles = stated["mesh"]["triangles"]
    stated["mesh"]["triangles"] = [triangle for triangle in triangles if node not in triangle]


def replace_anything(stated, rng):
    """Something anywhere in the tree becomes another value, or goes."""
    tree = stated
    while True:
        key = rng.choice(list(tree)) if isinstance(tree, dict) else place_in(tree, rng)
        if not (isinstance(tree[key], list | dict) and tree[key] and rng.random() < 0.8):
            break
        tree = tree[key]
    if rng.random() < 0.2:
        del tree[key]
    else:
        tree[key] = rng.choice(VALUES)


CORRUPTIONS = [
    *(change_values(name, count) for name in ("v", "flux", "trace", "field") for count in (1, 10)),
    *(kind(name) for kind in (multiply, shift) for name in ("v", "flux", "trace", "field")),
    *(kind(name) for kind in (shuffle, exchange_values, change_length) for name in ("v", "flux", "trace")),
    *[move_node, exchange_nodes, move_boundary_node, omit_boundary_node, add_boundary_node, turn_triangle],
    *[rotate_triangle, flip_edge, change_corner, omit_triangle, double_triangle, overlap, make_hole],
    *[add_function] * 8,
    *[replace_anything] * 8,
]


def corrupt(text, rng):
    """A certificate that one corruption or two have changed, from its text."""
    stated = json.loads(text)
    for _ in range(rng.choice([1, 1, 2])):
        try:
            rng.choice(CORRUPTIONS)(stated, rng)
        except (KeyError, IndexError, TypeError, ValueError, AttributeError, OverflowError):
            replace_anything(stated, rng)  # there is no such field, or the first corruption has spoilt it
    return stated


@pytest.fixture
def run(tmp_path, capsys, monkeypatch):
    """Exit code and output of a checker for the bytes or the tree of a certificate in a file."""

    def run(module, stated, ending=".json"):
        path = tmp_path / f"corrupted{ending}"
        path.write_bytes(stated if isinstance(stated, bytes) else json.dumps(stated).encode())
        monkeypatch.setattr(sys, "argv", ["check.py", str(path)])
        code = module.main()
        return code, capsys.readouterr().out

    return run


def stated_problem(output):
    return output.partition("\n  v is linear")[0]


def printed_bound(output):
    """The bound on |||u - v||| in the output."""
    return Decimal(output.partition(PRINTED)[2].partition(",")[0])


@pytest.fixture
def judge(run):
    """Counts what a checker says of corruptions, and gives the least bound over error that it prints.

    A corruption that lowers this index is kept, and the next ones are made of it. One lie is enough.
    """

    def judge(module, make):
        rng = random.Random(46)
        counts = Counter()
        minimum = math.inf
        stated, u = make()
        original = stated_problem(run(module, stated)[1])
        text = json.dumps(stated)
        for _ in range(COUNT // len(PROBLEMS)):
            stated = corrupt(text, rng)
            code, output = run(module, stated)
            assert code in (0, 1)
            assert output.startswith("REFUSED: ") == (code == 1)
            if code:
                counts["refused"] += 1
            elif stated_problem(output) != original:
                counts["another problem"] += 1
            else:
                counts["accepted"] += 1
                index = float(printed_bound(output)) / true_error(stated, u)
                if index < minimum:
                    text = json.dumps(stated)
                    minimum = index
                if minimum < 1 - ROUNDING:
                    break
        return counts, minimum

    return judge


@pytest.mark.parametrize("make", PROBLEMS)
def test_each_corruption_is_refused_or_its_bound_holds(make, judge):
    counts, minimum = judge(checker(), make)
    assert minimum >= 1 - ROUNDING
    assert counts.total() == COUNT / len(PROBLEMS)
    assert min(counts["refused"], counts["accepted"]) > counts.total() / 5  # so that both are tried


@pytest.mark.parametrize(
    ("make", "component"),
    [
        (full_contact, "v + y >= g"),
        (make_slanted_certificate, "rho - mean of rho"),
        (clamped_and_free, "|||y|||"),
    ],
)
def test_a_spoilt_checker_is_exposed(make, component, judge):
    """Control."""
    attack = next(attack for attack in ATTACKS if attack.checker_part == component)
    _, minimum = judge(checker((attack.text, attack.replacement)), make)
    assert minimum < 1 - ROUNDING


@pytest.mark.parametrize("ending", [".json", ".json.gz"])
def test_spoilt_bytes_are_refused_or_the_bound_holds(ending, run):
    """One byte of the file is another one, or its end is missing. Bytes that are not read have no effect."""
    stated, u = gaps()
    full_compress = json.dumps(stated).encode()
    rng = random.Random(47)
    module = checker()
    full_compress = gzip.compress(full_compress, mtime=0) if ending == ".json.gz" else full_compress
    codes = Counter()
    for _ in range(80):
        spoilt = bytearray(full_compress)
        place = rng.randrange(len(full_compress))
        spoilt[place] = rng.choice(b'0123456789-.,:[]{}"e x\xff')
        code, output = run(
            module, bytes(spoilt[: rng.choice([len(full_compress), len(full_compress), place])]), ending
        )
        codes[code] += 1
        if (
            code == 0
            and ending == ".json"
            and stated_problem(output) == stated_problem(run(module, stated)[1])
        ):
            assert printed_bound(output) >= Decimal((1 - ROUNDING) * true_error(json.loads(spoilt), u))
    assert codes[2] >= 20  # a third of the files have no end
    assert set(codes) <= {0, 1, 2}


@pytest.mark.parametrize("name", ["v", "flux", "trace"])
@pytest.mark.parametrize("number", [10**400, -(10**400)])
def test_integers_beyond_doubles_are_computed_with(name, number, run):
    """The norm of a hat function is larger than 1e-10 here, and so is the true error if v has the integer."""
    stated, u = gaps()
    error = Decimal("1e390") if name == "v" else Decimal(true_error(stated, u))
    stated[name][0] = number
    code, output = run(checker(), stated)
    assert code == 1 or printed_bound(output) >= error
