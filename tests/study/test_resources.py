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


def study(levels):
    """The unit square, 4^(levels + 1) unknowns on its finest mesh."""
    scene = {"polygon": "square", "mesh": {"h": "1/4", "levels": levels}}
    return {"resources": GIVEN, "scenes": {"trial": scene}}


@pytest.mark.parametrize(
    ("n", "mb", "seconds"),
    [
        (100, 110, 9),  # the smaller one itself
        (25, 35, 2),  # 10 + 100/4, 1 + 8/8
        (399, 409, 1 + 8 * 3.99**1.5),  # from the smaller one: the other is larger than what is asked for
        (400, 250, 50),  # the larger one itself
        (1600, 970, 393),  # 10 + 4 240, 1 + 8 49
    ],
)
def test_a_measured_job_is_predicted_as_it_was_and_others_grow_from_it(n, mb, seconds):
    """Control: another power of n, or growth of the start, gives other numbers."""
    assert resources.predicted(GIVEN, "solve", "mb", n) == pytest.approx(mb, rel=1e-12)
    assert resources.predicted(GIVEN, "solve", "seconds", n) == pytest.approx(seconds, rel=1e-12)


def test_what_is_asked_has_a_margin_and_room_for_snakemake():
    """30 + 2 60 = 150 MB; 20 + 4 3 = 32 s, which is a minute."""
    assert resources.mem_mb(study(1), "rates", {"scene": "trial"}) == 150
    assert resources.runtime(study(1), "rates", {"scene": "trial"}) == 1


def test_a_job_that_is_tried_again_asks_for_more():
    asked = [resources.mem_mb(study(1), "rates", {}, attempt) for attempt in (1, 2, 3)]
    assert asked == [150, 300, 450]
    assert resources.runtime(study(1), "rates", {}, 2) == 2


def test_a_finer_mesh_asks_for_more():
    """4^5 and 4^6 unknowns, n: 30 + 2 (10 + 240 n / 400), rounded up to 50."""
    sizes = [resources.size(study(levels), "solve", {"scene": "trial"}) for levels in (4, 5)]
    assert sizes == [4**5, 4**6]
    wanted = [30 + 2 * (10 + 240 * n / 400) for n in sizes]
    asked = [resources.mem_mb(study(levels), "solve", {"scene": "trial"}) for levels in (4, 5)]
    assert all(0 <= mb - least < 50 for mb, least in zip(asked, wanted, strict=True))


def test_every_rule_with_a_script_asks_for_what_is_declared_for_it():
    """Control: a rule without the line, or with another rule's name, is found by the same pattern."""
    text = "\n".join(path.read_text() for path in sorted((ROOT / "workflow/rules").glob("*.smk")))
    rules = re.findall(r"^rule (\w+):\n((?:    .*\n|\n)*)", text, re.MULTILINE)
    asked = {name: re.findall(r'\*\*asked\("(\w+)"\)', body) for name, body in rules if "script:" in body}
    assert len(asked) >= 17
    assert asked == {name: [name] for name in asked}
