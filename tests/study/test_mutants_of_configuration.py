"""The study's configuration, changed at random: what makes no sense is refused in one line."""

import copy
import datetime
import math
import re

import numpy as np
from configured import SOURCE, STUDY, fault, parent

VALUES = {
    "infinite": math.inf, "minus infinite": -math.inf, "nan": math.nan, "negative": -1, "zero": 0,
    "huge": 10**30, "huge float": 1e300, "tiny": 1e-300, "digits": "1" * 5000, "float": 2.5, "three": 3,
    "half": "1/2", "scientific": "1e-3", "null": None, "true": True, "text": "text", "empty": "",
    "upper": "Natural", "path": "../../etc/passwd", "date": datetime.date(2000, 1, 1), "list": [],
    "mapping": {}, "nested": {"x": [1]},
}  # fmt: skip
KEYS = {
    "path": "../../etc/passwd", "number": 7, "newline": "square\n", "empty": "", "upper": "Square",
    "null": None, "long": "a" * 300,
}  # fmt: skip
SIZES = "huge|huge float|tiny|float|three|half"
ACCEPTED = [
    # A list may be shorter; a study may have fewer surveys and figures; some fields have defaults.
    (r".*\.\d+", "removed"),
    (r"(scenes|surveys|totals\.scenes|rates\.cases)\.[\w.]+?|figures\.\w+", "removed"),
    (r".*\.(max|edge_ratio|smallest_angle)", "removed"),
    (r"extremes\.axes\.\w+(\.(h|H|accuracy))?|cost\.axes\.\w+(\.\w+)?", "removed"),
    # Any positive number is a size, and what is too fine is refused when it is made.
    (r"(.*\.)?(h|H|h_over_H|H_over_h|values|edges_per_cell|eliminated|ratios|uniform_ratios)(\.\d+)?", SIZES),
    (r"cost\.h\.\w+(\.\d+)?", SIZES),
    (r".*\.(fitted_from|shift|grading|spread|edges_per_cell|radius|reference)", SIZES),
    (r"graded\.scenes\.\d+\.kappas\.\d+", "tiny|half"),
    (r"surveys\.\w+\.deltas(\.\d+)?", "tiny|half"),
    (r"multipliers\.stabilisation", "tiny"),
    (r".*\.shift", "zero"),
    (r".*\.(min|max|rate|proved|tolerance|factor|power_of_H|algebraic_share)", f"zero|{SIZES}"),
    # Other numbers within their limits.
    (
        r".*\.(levels|max_steps|steps|compared_steps|costly_steps|unknowns|of_beta|normed|adapted|period|positions|side|"
        r"seed)",
        "three|zero",
    ),
    (r".*\.(counts|recorded_steps|gammas|alphas|shares|targets)\.\d+", "three|float|half|tiny"),
    (r".*\.(cell_over_edge|smallest_angle|edge_ratio|beta)", "zero|three|float|tiny"),
    (r".*\.(accuracy|memory|fraction)", "three|float|tiny"),
    (r"finds\.\w+\.\d+\.(points|nodes)\.\d+", "zero|tiny|three|float"),
    (r"cost\.stops\.\d+", "tiny"),
    (r"extremes\.reaction\.c_over_k\.\d+", "three|float|huge|huge float|tiny"),
    (r"surveys\.\w+\.polygon\.\d\.\d", "zero|three|float|negative|huge|tiny"),
    # Text for readers.
    (r".*\.(source|reason)", "text|upper|path|half|scientific|digits|newline"),
    (r".*\.(label|name|what|shows|f)", "text|upper|path|half|scientific|digits"),
    (r".*\.judged", "true"),
    (r"floors|u_in_l2", "list"),
]
"""Places and changes that leave a configuration that makes sense."""


def places(value, position=()):
    """All places in nested mappings and lists, but the whole."""
    inside = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, component in inside:
        yield (*position, key)
        yield from places(component, (*position, key))


def mutant(rng, place):
    """The study changed at a place, and how; or None where that is no change."""
    study = copy.deepcopy(STUDY)
    above = parent(study, place)
    last = place[-1]
    old = above[last]
    how = str(rng.choice(["value"] * 6 + ["removed", "newline", "extra", "key", "entry"]))
    if how == "value":
        how = str(rng.choice(list(VALUES)))
        above[last] = VALUES[how]
    elif how == "removed":
        del above[last]
    elif how == "newline" and isinstance(old, str):
        above[last] = f"{old}\n"
    elif how in ("extra", "key") and isinstance(old, dict) and old:
        name = str(rng.choice(list(KEYS)))
        selected = list(old)[rng.integers(len(old))]
        value = old[selected] if how == "extra" else old.pop(selected)
        old[KEYS[name]] = copy.deepcopy(value)
        how = f"{how} {name}"
    elif how == "entry" and isinstance(old, list):
        old.append(old[0] if rng.random() < 0.5 else "../../etc/passwd")
    return None if study == STUDY else (study, how)


def test_mutants_are_refused_in_one_line_but_for_those_that_make_sense():
    """Some 200, of all places, but for most of the numbers that the search for the worst beta found.

    The longest line lists all cases.
    """
    rng = np.random.default_rng(7)
    accepted = []
    number = 0
    chosen_places = list(places(STUDY))
    chosen_places = [place for place in chosen_places if "finds" not in place or rng.random() < 0.1]
    for place in (chosen_places[i] for i in rng.integers(len(chosen_places), size=250)):
        changed_study = mutant(rng, place)
        if changed_study is None:
            continue
        message = fault(changed_study[0])
        number = number + 1
        if message is None:
            accepted.append((".".join(map(str, place)), changed_study[1]))
        else:
            assert re.match(rf"{SOURCE}(, field \S+)?: [^\n]*\Z", message)
            assert len(message) < 450
    assert number > 160
    surprising = [
        (place, how)
        for place, how in accepted
        if not any(re.fullmatch(position, place) and re.fullmatch(hows, how) for position, hows in ACCEPTED)
    ]
    assert surprising == []
