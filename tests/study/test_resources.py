"""What jobs ask a cluster for. Expected values are computed by hand from small declared figures."""

import re

import pytest
from conftest import ROOT

from unilateral.study import resources

MEASURED = [{"size": 100, "mb": 110, "seconds": 9}, {"size": 400, "mb": 250, "seconds": 50}]
GIVEN = {
    "start": {"mb": 10, "seconds": 1},
    "snakemake": {"mb": 30, "seconds": 20},
    "margin": {"mb": 2, "seconds": 4},
    "rules": {
        "solve": {"growth": {"mb": 1, "seconds": 1.5}, "measured": MEASURED},
        "rates": {"growth": {"mb": 1, "seconds": 1.5}, "measured": [{"size": 1, "mb": 60, "seconds": 3}]},
    },
}


TRIAL = {"scene": "trial"}


def study(h, levels=1):
    """The unit square, on its finest mesh 4^(levels - 1) / h^2 unknowns."""
    scene = {"polygon": "square", "mesh": {"h": h, "levels": levels}}
    return {"resources": GIVEN, "scenes": {"trial": scene}}


@pytest.mark.parametrize(
    ("h", "mb", "seconds"),
    [
        ("1/10", 110, 9),  # the smaller one itself
        ("1/5", 35, 2),  # 10 + 100/4, 1 + 8/8
        ("1/19", 371, 1 + 8 * 1.9**3),  # from the smaller one: the other is larger
        ("1/20", 250, 50),  # the larger one itself
        ("1/40", 970, 393),  # 10 + 4 240, 1 + 8 49
    ],
)
def test_a_measured_job_is_predicted_as_it_was_and_others_grow_from_it(h, mb, seconds):
    """Control: another power of the size, or growth of the start, gives other numbers."""
    assert resources.predicted(study(h), "solve", TRIAL, "mb") == pytest.approx(mb, rel=1e-12)
    assert resources.predicted(study(h), "solve", TRIAL, "seconds") == pytest.approx(seconds, rel=1e-12)


def test_what_is_asked_has_a_margin_and_room_for_snakemake():
    """30 + 2 60 = 150 MB; 20 + 4 3 = 32 s, which is a minute."""
    assert resources.mem_mb(study("1/4"), "rates", TRIAL) == 150
    assert resources.runtime(study("1/4"), "rates", TRIAL) == 1


def test_a_job_that_is_tried_again_asks_for_more():
    asked = [resources.mem_mb(study("1/4"), "rates", {}, attempt) for attempt in (1, 2, 3)]
    assert asked == [150, 300, 450]
    assert resources.runtime(study("1/4"), "rates", {}, 2) == 2


def test_a_finer_level_asks_for_more():
    """32^2 and 64^2 unknowns, n: 30 + 2 (10 + 240 n / 400), rounded up to 50: 1278.8 and 4965.2."""
    assert [resources.size(study("1/4", levels), "solve", TRIAL) for levels in (4, 5)] == [32**2, 64**2]
    assert [resources.mem_mb(study("1/4", levels), "solve", TRIAL) for levels in (4, 5)] == [1300, 5000]


def test_every_rule_with_a_script_asks_for_what_is_declared_for_it():
    """Control: a rule without the line, or with another rule's name, is found by the same pattern."""
    text = "\n".join(path.read_text() for path in sorted((ROOT / "workflow/rules").glob("*.smk")))
    rules = re.findall(r"^rule (\w+):\n((?:    .*\n|\n)*)", text, re.MULTILINE)
    asked = {name: re.findall(r'\*\*asked\("(\w+)"\)', body) for name, body in rules if "script:" in body}
    assert len(asked) >= 17
    assert asked == {name: [name] for name in asked}
