"""g on the edges of a mesh: it is within its doubt of p there, where g is hardly known, too."""

from dataclasses import replace

import numpy as np
import pytest

import unilateral as ul
from unilateral.bounds import feasible
from unilateral.bounds.constraint import Constraint, constraint
from unilateral.geometry.structured import structured
from unilateral.problems import piecewise

SQUARE = [(0, 0), (1, 0), (1, 1), (0, 1)]
WAVES = {
    "sin(40*pi*x) + y": lambda x, y: np.sin(40 * np.pi * x) + y,
    "100000*cos(3*x - y)": lambda x, y: 1e5 * np.cos(3 * x - y),
}


def on_edges(text, n=4):
    """The constraint on all edges of a mesh of the unit square."""
    problem, mesh = ul.Problem(SQUARE, f=0, g=text), structured(ul.Problem(SQUARE, f=0, g=0).polygon, 1 / n)
    return constraint(problem.enclosed_obstacle, mesh, np.ones(len(mesh.boundary), dtype=bool))


@pytest.mark.parametrize("text", WAVES)
@pytest.mark.parametrize("most", [8, 60_000])
def test_g_is_within_the_doubt_of_p(text, most, monkeypatch):
    """In the points of the rule, against numpy. With 8 pieces the doubt is of the size of what p misses."""
    monkeypatch.setattr(piecewise, "MOST_PIECES", most)
    found = on_edges(text)
    s = found.mesh.s[found.edge][:, None] + found.x * np.diff(found.mesh.s)[found.edge][:, None]
    side = np.broadcast_to(found.mesh.side[found.edge][:, None], s.shape).ravel()
    points = found.mesh.polygon.at(side, s.ravel() - found.mesh.polygon.starts[side])
    g = WAVES[text](*points.T).reshape(s.shape)
    away = np.abs(g - found.p).max(axis=1)
    assert np.all(away <= found.doubt + 1e-15 * np.abs(g).max())
    assert np.all(g.max(axis=1) <= found.upper + 1e-15 * np.abs(g).max())
    if most == 8 and "40" in text:
        assert np.any(away > 0.5)
    if most > 8:
        assert found.doubt.max() <= 1e-9 * np.abs(g).max()


def test_what_is_added_for_the_doubt_is_pressed_like_the_doubt():
    """v = p = 0 on the unit square, doubt 1/1000, q.n = 1: v + 1/1000 - g may be 2/1000 all around."""
    found = on_edges("0")
    g = replace(found, doubt=np.full_like(found.doubt, 1e-3))
    nb = len(g.mesh.boundary)
    every, v = np.ones(nb, dtype=bool), np.zeros(2 * nb)
    missing = feasible.missing(g, v, every, np.ones((nb, 2)))
    assert missing.added == pytest.approx(1e-3)
    assert missing.product == pytest.approx(8e-3)


def short_of(g, rng):
    """Of v from just below g to far above, at midpoints, too, and sigma > 0 on every third edge."""
    nb = len(g.unknowns)
    v = np.where(rng.random(2 * nb) < 0.2, g.at_unknowns, g.at_unknowns + rng.uniform(-0.1, 4, 2 * nb))
    contact, flux = v == g.at_unknowns, np.where(np.arange(nb) % 3 == 0, rng.random((2, nb)), 0.0).T
    v, touching = feasible.raised(g, v, contact, flux, rng.random(nb))
    v[nb:] -= rng.uniform(0, 4, nb)
    return [v, touching, *feasible.missing(g, v, touching, flux), g.near(v, touching)]


@pytest.mark.parametrize("seed", range(4))
def test_intervals_of_edges_far_from_g_change_nothing(seed, monkeypatch):
    """Against all of them; some are left out. Control: so they do where v is told by its ends only."""
    g = on_edges("sin(9*pi*x) + y", 16)
    *found, near = short_of(g, np.random.default_rng(seed))
    kept = Constraint.near
    monkeypatch.setattr(Constraint, "near", lambda self, v, also: self)
    *wanted, every = short_of(g, np.random.default_rng(seed))
    assert 0 < len(near.edge) < len(every.edge)
    for one, other in zip(found, wanted, strict=True):
        assert np.array_equal(one, other)

    def by_ends(self, v, also):
        level = v.copy()
        level[self.unknowns[:, 2]] = 0.5 * v[self.unknowns[:, :2]].sum(axis=1)
        return kept(self, level, also)

    monkeypatch.setattr(Constraint, "near", by_ends)
    *wrong, _ = short_of(g, np.random.default_rng(seed))
    assert wrong[2].sum() < 0.99 * wanted[2].sum()
