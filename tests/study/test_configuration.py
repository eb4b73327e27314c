"""The study's configuration: what is refused, where, and in which words; and what is still accepted."""

import copy
import math
import re
from collections.abc import Iterator
from pathlib import Path

import jsonschema
import pytest
import sentences
import yaml
from configured import FILES, REMOVED, SCHEMA, SOURCE, SOURCES, STUDY, WHOLE, change_study, fault
from conftest import ROOT

from study import config as configuration
from unilateral.errors import InputError
from unilateral.system.declarations import MAX_YAML_NODES

SCHEMAS = [Path(SCHEMA), *(ROOT / "src/study/experiments").glob("*/schema.yaml")]
RULES = [yaml.safe_load(file.read_text()) for file in SCHEMAS]


def test_the_study_is_accepted_and_its_schemas_are_some():
    full, *components = RULES
    for properties in (full["properties"], *components):
        jsonschema.Draft202012Validator.check_schema({**full, "properties": properties})
    study = copy.deepcopy(WHOLE)
    assert fault(study) is None
    assert study == WHOLE


REFUSED = {
    "speed": [1],
    7: [1],
    "stop.fraction": [0, "1 %"],
    "stop.max_steps": [1.5],
    "scenes.Square": [{}],
    "surveys.betasquare.partitions": [
        [{"H": "1/16", "shift": 1}],
        [{"H": math.inf}],
        [{"H": "1/16", "spread": 2}],
        [{"size": "1/16"}],
        [{"counts": [4, 4, 4]}],
        ["1/16"],
    ],
    "surveys.betasquare.kind": ["odd"],
    "scenes.quick.h": ["1/8"],
    "scenes.quick.polygon": ["disc"],
    "scenes.quick.side": [-1],
    "scenes.quick.cases": [
        [],
        "natural",
        ["natural", "natural"],
        ["../../etc/passwd"],
        ["natural.yaml"],
        ["natural\n"],
    ],
    "scenes.quick.mesh.levels": [0, True, 4.0],
    "scenes.quick.mesh.h": [
        "1/8\n",
        math.inf,
        math.nan,
        "1/0",
        "0/1",
        "0.0",
        0,
        -0.125,
        "-1/8",
        "1 / 8",
        "1/8/2",
        "eighth",
        None,
    ],
    "scenes.quick.H_over_h.max": [math.inf, -1],
    "scenes.../../etc/passwd": [{}],
    "scenes.sharpness": [{}],
    "scenes.adaptive": [{}],
    "scenes.cells": [{}],
    "scenes.graded": [{}],
    "surveys.betasquare.mesh": [{"kind": "found"}, {"kind": "graded"}, {"kind": "equal", "seed": 1}, "equal"],
    "surveys.betathin.polygon": [[[0, 0], [0, 1], [1, 0]]],
    "surveys.betaworst.edges_per_cell": [[2]],
    "surveys.betaworst.polygon": ["square"],
    "surveys.betaworst.kind": ["local"],
    "surveys.betanode.edges_per_cell": [[2]],
    "surveys.betanode.deltas": [[0.6], ["2/3"], []],
    "surveys.betanode.mesh": [{"kind": "inner", "ends": False}, {"kind": "inner", "spread": 2}],
    "surveys.betasquare.deltas": [["1/2"]],
    "algorithm.shares": [["1/2"]],
    "multipliers.stabilisation": ["1/2", 0.7, 0],
    "scenes.quick.H": ["1/8", ["1/4", "1/0"]],
    "scenes.quick.H_over_h.least": [2],
    "scenes.quick.judged": ["no"],
    "figures.Rates": [{}],
    "figures.rates": [{"shows": "errors"}],
    "figures.rates.scenes": [[], ["nowhere"]],
    "figures.verdict.module": ["style"],
    "figures.grid_square": [{"shows": "errors"}],
    "figures.grid_square.colour": ["red"],
    "adaptive.scenes": [[], [{"polygon": "square"}]],
    "figures.grid_square.cases": [["natural", ["thirds"]], ["thirds", "thirds"], 3],
    "figures.consistency.H": [0],
    "figures.multiplier.h_over_H": [[], "1/2"],
    "documents": [["../../etc/passwd"], ["README"], ["paper.md", "paper.md"]],
    "adaptive.examples": [["../../etc/passwd"]],
    "adaptive.h": [0],
    "adaptive.most.unknowns": [0],
    "adaptive.most.of_beta": [0.5],
    "adaptive.factor": [1],
    "cells.period": [1],
    "cells.H": [["1/9", "1/8"]],
    "cells.cases": [["thurds"]],
    "graded.algorithm": ["fast"],
    "graded.normed": [0],
    "graded.adapted": [0.5],
    "graded.scenes": [[], [{"polygon": "lshape", "cases": ["reentrant_full"]}]],
    "sharpness.alphas": [["1"], ["1/21"], [0.25]],
    "sharpness.gammas": [[0], ["-1/2"], [1, 1]],
    "sharpness.positions": [0],
    "sharpness.H": [["1/8", "1/16"]],
    "sharpness.h_over_H": ["0/1"],
    "sharpness.fixed.H": [["1/8", "1/16"]],
    "sharpness.fixed.h": [0],
    "cost.base.algebra": ["A_2"],
    "cost.axes": [{}, {"../scene": {"scene": ["lshape"]}}],
    "cost.axes.case.speed": [[1]],
    "cost.axes.case.H_over_h": [["0"]],
    "cost.axes.algorithm.algorithm": [["fast"]],
    "cost.h": [{}],
    "cost.h.nowhere": [["1/8"]],
    "cost.stops": [[2.0]],
    "cost.costly_steps": [0],
    "extremes.accuracy": [0],
    "extremes.axes.ratio.values": [[1], [1, -1]],
    "extremes.axes.ratio.steps": [3],
    "extremes.axes": [{}],
    "extremes.reaction.h": [[], ["1/0"]],
    "extremes.reaction.c_over_k": [[1], [0, 1], [1.0, 1.0], [1.0, 1e-30], ["1/8", "1"], [1.0, math.inf]],
    "figures.solution.levels": [3],
    "rates.judged_ratio": ["0"],
    "rates.norms.h1.bound.reference": ["h"],
    "rates.norms.energy": [{}],
    "rates.cases.thirds.h1.rate": ["fast"],
    "rates.cases.thirds.l2.unproved": [["nowhere"], []],
}
"""Values of fields that are refused."""
NEEDED = [
    "adaptive", "cells", "cost", "cost.base.case", "extremes", "extremes.reaction",
    "figures.consistency.case", "figures.rates.shows", "figures.solution.H", "finds", "finds.betarule",
    "graded", "graded.normed", "rates", "rates.cases.thirds.h1.source", "scenes.quick.judged",
    "scenes.quick.polygon", "scenes.quick.side", "scenes.square", "sharpness",
    "sharpness.fixed", "surveys.betanode.deltas", "surveys.betasquare.partitions",
]  # fmt: skip
"""Fields that may not be left out."""


@pytest.mark.parametrize(
    ("path", "value"),
    [*((path, value) for path in REFUSED for value in REFUSED[path]), *((path, REMOVED) for path in NEEDED)],
)
def test_a_bad_value_is_refused_where_it_stands(path, value):
    """In the field itself, or in the mapping that lacks it, has it in vain, or has its name.

    What is said in which words of further ones is in the next test.
    """
    message = fault(change_study(path, value))
    field = re.match(rf"{SOURCE}(?:, field ([\w.\[\]]+))?: ", message)[2] or ""
    assert str(path).startswith(field) or field.startswith((f"{path}[", f"{path}."))
    assert "\n" not in message
    assert len(message) < 400


SAID = [
    ("scenes.quick.mesh.levels", "four"),
    ("scenes.quick.mesh.kind", "quads"),
    ("stop.steps", 10),
    ("rates.judged_ratio", math.nan),
    ("scenes.Quick", {}),
    ("scenes.cost", STUDY["scenes"]["quick"]),
    ("surveys.betasquare.partitions", [{"H": "1/16", "seed": 1}]),
    ("surveys.betasquare.partitions", [{"H": "1/16", "grading": "1/2"}]),
    ("finds.betarule", REMOVED),
    ("finds.betathin", STUDY["finds"]["betaworst"]),
    ("finds.betaworst", [STUDY["finds"]["betaworst"][0] | {"polygon": [[0, 0], [0, 1], [1, 0]]}]),
    ("surveys.betathin.mesh", {"kind": "structured"}),
    ("totals.scenes.nowhere", ["thirds"]),
    ("scenes.quick.cases", ["natural", "third"]),
    # the scene is named, and not totals, which has natural still
    ("scenes.square.cases", ["naturl", *STUDY["scenes"]["square"]["cases"][1:]]),
    ("scenes.quick.cases", ["violates_j"]),
    ("adaptive.scenes", [{"polygon": "square", "cases": ["thirds", "reentrant"]}]),
    ("scenes.quick.side", 4),
    ("rates.cases.vertex", REMOVED),
    ("figures.grid_square.cases", ["rough"]),
    ("figures.rates.scenes", ["square", "nowhere"]),
    ("scenes.quick.H", ["1/8", "1/4"]),
    ("extremes.axes.even", {"label": "even", "values": [1, 2]}),
    ("totals.levels", 7),
    ("rates.judged_ratio", "1/3"),
    ("stop", REMOVED),
]


@pytest.mark.parametrize(("path", "value"), SAID)
def test_refusals_name_the_file_and_the_field(path, value):
    """One line with the file, the field and what would be right."""
    partition = path.partition(".")[0]
    names = FILES if path == partition else [f"{SOURCES[partition]}, field {partition}"]
    with sentences.raises(InputError, *names):
        configuration.check(change_study(path, value), SOURCES, SCHEMA)


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ("totals.scenes.lshape", ["natural"]),
        ("floors", ["nowhere"]),
        ("u_in_l2", ["nowhere"]),
        ("figures.consistency.case", "reentrant"),
        ("cost.base.scene", "nowhere"),
        ("cost.base.case", "natural"),
        ("cost.axes.scene.scene", ["nowhere"]),
        ("cost.axes.scene.scene", ["unstructured"]),
        ("cost.axes.case.case", ["rough"]),
        ("cost.h", {"nowhere": ["1/8"]}),
        ("algorithm.cases", ["violates_j"]),
    ],
)
def test_a_name_that_stands_for_nothing_is_refused(path, value):
    """`natural` is for the square only, and the study of cost varies the scene of its base's case."""
    assert f"field {path}" in fault(change_study(path, value))


@pytest.mark.parametrize("size", ["1/8", "0.125", 0.125, 1, "10/3", "1/10", "0.5/4"])
def test_sizes_in_any_form_are_accepted(size):
    assert fault(change_study("scenes.quick.mesh.h", size)) is None


def patterns(rules) -> Iterator[dict]:
    if isinstance(rules, dict):
        if isinstance(rules.get("pattern"), str):
            yield rules
        rules = list(rules.values())
    if isinstance(rules, list):
        for rule in rules:
            yield from patterns(rule)


def test_a_pattern_holds_to_the_very_end_and_says_what_it_asks_for():
    """`$` would match before a newline."""
    pattern_rules = list(patterns(RULES))
    assert len(pattern_rules) > 8
    for rules in pattern_rules:
        assert re.fullmatch(r"\^[^$]*\\Z", rules["pattern"].replace("\\Z)", ")"))
        assert rules["description"]


@pytest.mark.parametrize(
    "contents",
    [
        ("stop: 1\n", "stop: 1\n"),
        ("stop: 1\nstop: 2\n",),
        ("stop: [1\n",),
        ("",),
        ("- 1\n",),
    ],
)
def test_files_that_repeat_a_field_or_hold_no_mapping_are_refused(tmp_path, contents):
    files = [tmp_path / f"{i}.yaml" for i in range(len(contents))]
    for file, content in zip(files, contents, strict=True):
        file.write_text(content)
    with sentences.raises(InputError):
        configuration.read_configuration(map(str, files))


def nest_lists(levels):
    return [nest_lists(levels - 1)] if levels else 1


EXTREME = {
    "long": (10**400, "it has more than 18 digits"),
    "longer than Python prints": (10**5000, "it has more than 18 digits"),
    "negative": (-(10**400), "it has more than 18 digits"),
    "deep": (nest_lists(500), "it is in more than 10 lists or fields"),
    "wide": ([1] * (MAX_YAML_NODES + 1), "..."),
    "fraction": ("1/" + "9" * 400, "..."),
    "digits": ("1" * 400, "..."),
}


@pytest.mark.parametrize("value", EXTREME)
@pytest.mark.parametrize("path", ["adaptive.factor", "algorithm.steps", "stop.fraction", "documents"])
def test_what_no_file_may_hold_is_refused_in_one_short_sentence(path, value):
    """As it can be given with --config. Control: `changed` with the value that is there is accepted."""
    data, message = EXTREME[value]
    report = fault(change_study(path, data))
    assert report is not None
    assert f", field {path}" in report
    assert message in report
    assert len(report) < 400


def test_the_longest_number_of_a_file_is_not_too_long():
    """Control: 18 digits are refused by the schema, if at all."""
    assert "digits" not in str(fault(change_study("algorithm.steps", 10**18 - 1)))
    assert "digits" in fault(change_study("algorithm.steps", 10**18))
