"""Which nodes of a mesh's boundary are its corners, if coordinates are rounded.

The true polygons are known: each mesh is made of one, and then written with few digits. What is right is the
number of sides of that polygon, or that the polygon is asked for.
"""

import re
import warnings
from collections import Counter

import numpy as np
import pytest
import sentences

import unilateral as ul
from unilateral.geometry import coordinate_rounding, outline
from unilateral.geometry.mesh import make_unstructured_mesh
from unilateral.geometry.outline import POLYGON_ADVICE
from unilateral.geometry.polygon import Polygon

pytestmark = pytest.mark.filterwarnings("ignore::unilateral.SolutionWarning")

SLIGHTEST = np.radians(0.1)
SHARPEST = np.radians(179)


def circumscribe_polygon(turns):
    """The vertices (n, 2) of the polygon about the unit circle that turns by `turns` (n,), in all by 2 pi."""
    normals = np.cumsum(turns) - turns[0]
    middle = normals + 0.5 * np.roll(turns, -1)
    half = 0.5 * np.roll(turns, -1)
    return np.column_stack([np.cos(middle), np.sin(middle)]) / np.cos(half)[:, None]


def random_turns(draw):
    """Turns that are 2 pi in all, of at least 0.1 and at most 179 degrees; about a third are slight ones."""
    n = int(draw.integers(3, 8))
    slight = np.exp(draw.uniform(np.log(SLIGHTEST), np.log(20 * SLIGHTEST), n // 3))
    if draw.random() < 0.2:
        slight = np.append(slight, draw.uniform(0.9, 1) * SHARPEST)
    while True:
        sharp_turns = draw.dirichlet(np.ones(n)) * (2 * np.pi - slight.sum())
        turns = draw.permutation(np.append(slight, sharp_turns))
        if turns.min() >= SLIGHTEST and turns.max() <= SHARPEST:
            return turns


def dent_polygon(vertices, draw):
    """The same with the middle of one side moved towards the circle's centre."""
    side = int(draw.integers(len(vertices)))
    a = vertices[side]
    b = vertices[(side + 1) % len(vertices)]
    depth = np.tan(0.5 * np.exp(draw.uniform(np.log(SLIGHTEST), np.log(0.3)))) * 0.5 * np.hypot(*(b - a))
    middle = 0.5 * (a + b)
    return np.insert(vertices, side + 1, middle * (1 - min(depth, 0.5) / np.hypot(*middle)), axis=0)


def fan(vertices, draw):
    """Points and triangles: the sides cut into one to eight edges, joined to the origin, the last point."""
    edges = draw.integers(1, 9, len(vertices))
    sides = np.roll(vertices, -1, axis=0) - vertices
    along = [np.arange(n)[:, None] / n * side for n, side in zip(edges, sides, strict=True)]
    places = np.repeat(vertices, edges, axis=0) + np.concatenate(along)
    k = np.arange(len(places))
    return np.append(places, [[0, 0]], axis=0), np.column_stack([k, np.roll(k, -1), np.full(len(k), len(k))])


def written(points, how, draw):
    """The points with few digits, and how they were rounded."""
    digits = int(draw.integers(4, 18))
    if how == "single precision":
        return points.astype(np.float32).astype(float), how
    if how == "decimals":
        decimals = digits - 1 - int(np.floor(np.log10(np.abs(points).max())))
        return np.round(points, decimals), f"{digits} digits"
    return np.array([[float(f"{x:.{digits - 1}e}") for x in point] for point in points]), f"{digits} digits"


def sample(seed):
    """A true polygon's number of sides, a mesh of it with rounded coordinates, and what was done to it."""
    draw = np.random.default_rng(seed)
    vertices = circumscribe_polygon(random_turns(draw))
    vertices = dent_polygon(vertices, draw) if draw.random() < 0.3 else vertices
    points, triangles = fan(vertices, draw)
    angle = draw.uniform(0, 2 * np.pi)
    size = 10.0 ** draw.uniform(-3, 3)
    turned = points @ [[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]]
    far = draw.choice([0, 10.0 ** draw.uniform(0, 7)])
    how = draw.choice(["digits", "decimals", "single precision"], p=[0.4, 0.4, 0.2])
    points, how = written(size * turned + far * draw.uniform(-1, 1, 2), str(how), draw)
    return len(vertices), points, triangles, how


def outcome(n_sides, points, triangles):
    """What became of the mesh: "read", "asked for the polygon", "spoilt", or how many sides were found."""
    try:
        n_sides_read = ul.mesh(points, triangles).polygon.n_sides
    except ul.InputError as error:
        # A rounding as large as edges lets nodes coincide and triangles overlap.
        return "asked" if POLYGON_ADVICE in str(error) else f"spoilt {error}"
    return "read" if n_sides_read == n_sides else f"{n_sides_read} sides for {n_sides}"


MESHES = range(300)
KNOWN = ("read", "asked", "spoilt")


def count_outcomes(seeds):
    """How often each outcome came; the spoilt ones are of meshes whose nodes coincide."""
    return Counter(outcome(*sample(seed)[:3]).split()[0] for seed in seeds)


SPOILT = "repeats node|on the same side|not simple|degenerate|lost in rounding|clockwise|one closed line"


def test_corners_of_rounded_meshes_are_found_or_asked_for():
    """Never another number of sides without a word.

    Most are read, and of those whose edges are longer than 1e5 times the rounding nine in ten. Where
    coordinates are rounded so far that nodes coincide or triangles overlap, that is told.
    """
    outcomes = {seed: outcome(*sample(seed)[:3]) for seed in MESHES}
    wrong = {seed: outcome for seed, outcome in outcomes.items() if outcome.split()[0] not in KNOWN}
    assert wrong == {}
    read = [seed for seed in MESHES if outcomes[seed] == "read"]
    assert len(read) > 0.6 * len(MESHES)
    sharp = [seed for seed in MESHES if edges_over_rounding(sample(seed)[1][:-1]) > 1e5]
    assert len(sharp) > 100
    assert len({*sharp} & {*read}) >= 0.9 * len(sharp)
    spoilt = [outcome for outcome in outcomes.values() if outcome.startswith("spoilt")]
    assert [subject for subject in spoilt if not re.search(SPOILT, subject)] == []


def edges_over_rounding(places):
    """The shortest edge over how far a node may be from its place."""
    edges = np.hypot(*(np.roll(places, -1, axis=0) - places).T)
    return edges.min() / coordinate_rounding.max_point_error(places)


def test_without_the_digits_turns_by_rounding_are_corners(monkeypatch):
    """Control: if all coordinates are taken for full doubles, turns by rounding are corners."""
    monkeypatch.setattr(coordinate_rounding, "rounding_units", lambda values: np.zeros(np.shape(values)))
    monkeypatch.setattr(
        outline, "_find_rounding_patterns", lambda turns, smallest: np.zeros(len(turns), dtype=bool)
    )
    assert any(subject.isdecimal() for subject in count_outcomes(MESHES[:40]))


SQUARE = np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])
TURN = np.array([[np.cos(0.3), np.sin(0.3)], [-np.sin(0.3), np.cos(0.3)]])
TURNED = SQUARE @ TURN


def cut_sides(vertices, n):
    """The places along a polygon whose sides are cut into n edges."""
    sides = np.roll(vertices, -1, axis=0) - vertices
    return (vertices[:, None] + np.arange(n)[:, None] / n * sides[:, None]).reshape(-1, 2)


def around(places, centre=(0, 0)):
    """Points and triangles: all edges of a closed line joined to one more point."""
    k = np.arange(len(places))
    return np.append(places, [centre], axis=0), np.column_stack([k, np.roll(k, -1), np.full(len(k), len(k))])


def shorten_numbers(points, digits):
    return np.array([[float(f"{x:.{digits}g}") for x in point] for point in points])


@pytest.fixture(scope="module")
def turned_mesh():
    """A mesh by gmsh of the unit square turned by 0.3, of size 1/16."""
    return make_unstructured_mesh(Polygon(TURNED, "turned"), 1 / 16)


@pytest.fixture(scope="module")
def exact_force(turned_mesh):
    """The force on side 0 of that mesh in full precision."""
    return force(turned_mesh)


@pytest.mark.parametrize("digits", [6, 8, 10])
def test_the_sides_of_a_turned_square_keep_their_numbers(digits, turned_mesh, exact_force):
    """The force is the one in full precision, 0.762, as few digits move nodes by 5e-6 at most.

    Side 0 is in contact, the others are free, and not three short edges of the first side.
    """
    with pytest.warns(ul.SolutionWarning, match="the polygon has 4 sides; the turns of its boundary at"):
        mesh = ul.mesh(shorten_numbers(turned_mesh.points, digits), turned_mesh.triangles)
    assert "4 sides" in repr(mesh)
    assert force(mesh) == pytest.approx(exact_force, abs=1e-4)
    assert exact_force == pytest.approx(0.762, abs=1e-3)


def force(mesh):
    s = ul.solve(ul.Problem(mesh, f=-1, g=0, free_sides=[1, 2, 3]), H=1 / 8)
    assert "4 sides" in str(s)
    return s.force().value


def test_a_square_in_full_precision_is_read_without_a_word(turned_mesh):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert ul.mesh(turned_mesh.points, turned_mesh.triangles).polygon.n_sides == 4


def test_nodes_are_moved_onto_the_sides_between_the_corners_as_given(turned_mesh):
    """The polygon has the coordinates of the file, and every boundary node lies on it up to round-off."""
    points = shorten_numbers(turned_mesh.points, 6)
    mesh = ul.mesh(points, turned_mesh.triangles)
    assert {*map(tuple, mesh.polygon.vertices)} <= {*map(tuple, points)}
    away = np.sum(
        (mesh.points[mesh.boundary] - mesh.polygon.vertices[mesh.side]) * mesh.polygon.normals[mesh.side],
        axis=1,
    )
    assert np.abs(away).max() < 1e-15
    assert 1e-7 < np.abs(mesh.points - points).max() < 1e-5


@pytest.mark.parametrize(("size", "decimals"), [(1.0, None), (1.0, 5), (1.0, 4)])
def test_a_parcel_at_coordinates_in_metres_has_four_sides(size, decimals):
    """50 m by 50 m at UTM coordinates, whose doubles have steps of 1e-9 m; also in a few decimals."""
    parcel = make_unstructured_mesh(Polygon(50 * TURNED + [512345.678, 5412345.123], "parcel"), size)
    points = parcel.points if decimals is None else np.round(parcel.points, decimals)
    assert ul.mesh(points, parcel.triangles).polygon.n_sides == 4


@pytest.mark.parametrize("decimals", [3, 4])
def test_what_is_not_clear_is_asked_for_and_read_with_the_polygon(decimals, turned_mesh):
    """On edges of 1/16 so few decimals may turn the boundary by 0.1 degrees."""
    points = np.round(turned_mesh.points, decimals)
    with sentences.raises(ul.InputError, POLYGON_ADVICE):
        ul.mesh(points, turned_mesh.triangles)
    mesh = ul.mesh(points, turned_mesh.triangles, polygon=TURNED)
    np.testing.assert_array_equal(mesh.polygon.vertices, TURNED)
    np.testing.assert_allclose(mesh.points, turned_mesh.points, rtol=0, atol=2 * 10.0**-decimals)


def test_a_polygon_that_the_mesh_does_not_have_is_refused(turned_mesh):
    """Control: nodes are moved by what rounding explains, and no farther."""
    points = np.round(turned_mesh.points, 4)
    with sentences.raises(ul.InputError):
        ul.mesh(points, turned_mesh.triangles, polygon=TURNED * 1.001)


@pytest.mark.parametrize(("digits", "clear"), [(5, False), (6, False), (12, True), (17, True)])
def test_an_arc_of_turns_as_small_as_rounding_does_not_become_a_side(digits, clear):
    """The top of the square is an arc of 199 turns of 0.01 degrees, 4e-3 high: all corners, or refused."""
    angle = np.radians(1) * np.linspace(1, -1, 201)
    top = np.column_stack([np.sin(angle), np.cos(angle) - np.cos(angle[0])]) / np.sin(angle[0])
    places = np.concatenate([[[-1, -1], [1, -1]], top]) @ TURN
    points_and_triangles = around(shorten_numbers(places, digits))
    if clear:
        assert ul.mesh(*points_and_triangles).polygon.n_sides == 203
    else:
        with pytest.raises(ul.InputError, match=re.escape(POLYGON_ADVICE)):
            ul.mesh(*points_and_triangles)


def test_a_corner_that_rounding_may_hide_is_asked_for(monkeypatch):
    """One of 0.1 degrees, at a distance of 0.02 from a vertex, is 3.5e-5 off the chord; 4 decimals hide it.

    In 8 decimals it is found, turned by any angle. Control: it is lost if it is not looked for.
    """
    bend = np.insert(SQUARE, 1, [[0.98, -0.02 * 0.98 * 1.1 * SLIGHTEST]], axis=0) - 0.5
    angles = 2 * np.pi * np.arange(0.5, 40) / 40
    turned = [bend @ [[np.cos(t), np.sin(t)], [-np.sin(t), np.cos(t)]] for t in angles]
    assert {outcome(5, *around(np.round(places, 8))) for places in turned} == {"read"}
    assert {outcome(5, *around(np.round(places, 4))) for places in turned} == {"asked"}
    monkeypatch.setattr(outline, "MIN_CORNER_RADIANS", 10.0)
    assert "4 sides for 5" in {outcome(5, *around(np.round(places, 4))) for places in turned}


def test_turns_as_small_as_rounding_that_add_up_are_refused():
    """A parabola 1e-4 high: its 19 turns are of 0.0023 degrees, and rounding makes up to 0.03 of each."""
    x = np.linspace(1, 0, 21)
    top = np.column_stack([x, 1 + 4e-4 * x * (1 - x)])
    places = np.concatenate([[[0, 0], [1, 0]], top]) @ TURN
    with sentences.raises(ul.InputError):
        ul.mesh(*around(np.round(places, 5), np.array([0.5, 0.5]) @ TURN))


@pytest.mark.parametrize(
    "change", [lambda p: p @ TURN, lambda p: 25.4 * p, lambda p: p / 3], ids=["turned", "inches", "thirds"]
)
@pytest.mark.parametrize("digits", [4, 5, 6, 8, 10])
@pytest.mark.parametrize("n", [8, 16, 64])
def test_rounding_that_the_coordinates_do_not_show_is_noticed(change, digits, n):
    """A square that is rounded first and then turned or scaled has 17 digits again."""
    places = change(shorten_numbers(cut_sides(TURNED, n), digits))
    with pytest.raises(ul.InputError, match=re.escape(POLYGON_ADVICE)):
        ul.mesh(*around(places, change(np.array([[0.5, 0.5]]) @ TURN)[0]))


@pytest.mark.parametrize("digits", [6, 8, 10])
def test_a_rounded_mesh_that_was_moved_is_still_seen_to_be_rounded(digits):
    places = shorten_numbers(cut_sides(TURNED, 16) + 5, digits) - 5
    assert ul.mesh(*around(places, np.array([0.5, 0.5]) @ TURN)).polygon.n_sides == 4


def test_coordinates_as_a_person_types_them_are_exact():
    """All turns are corners, however coarse a rounding to as many digits is; slight ones are not clear."""
    places = [(0, 0), (3, 0), (4, 1), (4, 3), (1, 3), (0, 1)]
    assert ul.mesh(*around(np.array(places), (2, 1.5))).polygon.n_sides == 6
    triangle = cut_sides(
        np.array([[0, 0], [1, 0], [0, 1]]), 10
    )  # its long side is off by 2e-8 in single precision
    with pytest.warns(ul.SolutionWarning, match="the polygon has 3 sides"):
        assert ul.mesh(*around(triangle.astype(np.float32), (0.3, 0.3))).polygon.n_sides == 3
    hexagon = np.round(cut_sides(circumscribe_polygon(np.full(6, np.pi / 3)), 3), 3)
    with pytest.raises(ul.InputError, match=re.escape(POLYGON_ADVICE)):
        ul.mesh(*around(hexagon))


@pytest.mark.parametrize("decimals", [4, 6])
def test_sides_along_the_axes_are_straight_in_any_number_of_digits(decimals):
    """Thirds, of which nodes between the corners keep one coordinate exactly."""
    assert ul.mesh(*around(np.round(cut_sides(SQUARE, 96), decimals), (0.5, 0.5))).polygon.n_sides == 4


# To how many digits numbers were rounded: known, because they are rounded here.
NUMBERS = np.random.default_rng(3).uniform(-1, 1, (40, 2)) * [3.0, 500.0]


@pytest.mark.parametrize("digits", [4, 7, 11, 15])
def test_the_unit_of_numbers_in_significant_digits_is_that_of_their_last_digit(digits):
    shortened = shorten_numbers(NUMBERS, digits)
    assert coordinate_rounding.significant_digits(shortened) == digits
    exponents = np.floor(np.log10(np.abs(shortened)))
    np.testing.assert_allclose(
        coordinate_rounding.rounding_units(shortened), 10.0 ** (exponents - digits + 1), rtol=1e-12
    )
    displaced = np.abs(shortened - NUMBERS) - np.spacing(np.abs(shortened))
    assert np.all(displaced <= 0.5 * coordinate_rounding.rounding_units(shortened))


@pytest.mark.parametrize("offset", [0, 5e6])
@pytest.mark.parametrize("decimals", [2, 5, 8])
def test_the_unit_of_decimals_is_that_of_their_last_place(decimals, offset):
    """Also where an offset was subtracted, which leaves round-off behind the last digit."""
    decimals_behind_offset = np.round(NUMBERS + offset, decimals) - offset
    if offset and decimals == 8:  # as many digits as a double has at that offset
        decimals = 17
    np.testing.assert_allclose(
        coordinate_rounding.rounding_units(decimals_behind_offset),
        10.0**-decimals if decimals < 17 else 0,
        rtol=1e-12,
    )


def test_the_unit_of_single_precision_is_its_spacing():
    numbers = NUMBERS.astype(np.float32)
    np.testing.assert_array_equal(coordinate_rounding.rounding_units(numbers), np.spacing(np.abs(numbers)))


def test_the_unit_of_single_precision_in_nine_digits_is_at_least_its_spacing():
    shortened = shorten_numbers(NUMBERS.astype(np.float32), 9)
    assert np.all(
        coordinate_rounding.rounding_units(shortened) >= np.spacing(np.abs(shortened).astype(np.float32))
    )


def test_doubles_have_no_unit_of_rounding():
    assert not coordinate_rounding.rounding_units(NUMBERS).any()
    assert coordinate_rounding.significant_digits([0.0]) == 0


def test_no_rounding_turns_a_boundary_by_more_than_is_said():
    """Nodes are moved to the ends of their radii; the worst moves of a straight line reach nine tenths."""
    draw = np.random.default_rng(5)
    places = cut_sides(circumscribe_polygon(np.full(5, 0.4 * np.pi)), 4)
    radii = draw.uniform(0.2, 1, len(places)) * 1e-3
    max_largest_turns = outline.largest_turns(places, radii)
    before = turns_of(places)
    worst = np.zeros(len(places))
    for _ in range(2000):
        angle = draw.uniform(0, 2 * np.pi, len(places))
        shifted = places + radii[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
        worst = np.maximum(worst, np.abs(turns_of(shifted) - before) / max_largest_turns)
    assert 0.9 < worst.max() <= 1


def turns_of(places):
    """(n,) the angles by which a closed line turns to the left, from its directions."""
    along = np.roll(places, -1, axis=0) - places
    angle = np.arctan2(along[:, 1], along[:, 0])
    return (angle - np.roll(angle, 1) + np.pi) % (2 * np.pi) - np.pi


@pytest.mark.parametrize("digits", [4, 6, 9])
def test_rounded_places_are_within_their_radii(digits):
    """And some are farther than two thirds of them."""
    places = np.random.default_rng(6).uniform(1, 9, (200, 2))
    away = np.hypot(
        *(shorten_numbers(places, digits) - places).T
    ) / coordinate_rounding.rounding_errors_of_points(shorten_numbers(places, digits))
    assert 0.67 < away.max() <= 1 + 1e-6
