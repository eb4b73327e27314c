import re
from functools import cache
from pathlib import Path

from study.code import digest_program
from study.documents import marks
from study.ledger.entries import read_entries
from study.scenes import dual_norm_partitions

SCENES = config["scenes"]
JUDGED = [name for name, scene in SCENES.items() if scene["judged"]]
SURVEYS = config["surveys"]
TOTALS = config["totals"]["scenes"]
SHOWN = config["figures"]


wildcard_constraints:
    scene="|".join(SCENES),


def code(script):
    """The digest of the code that a script runs, as a parameter of its rule.

    So a change of that code reruns the rule's jobs, and an edit of docstrings or of other code does not.
    """
    return lambda wildcards: digest_program(f"workflow/scripts/{script}.py")


def asked(mem_mb, minutes):
    """What a rule's jobs ask a cluster for, twice that at each further attempt; see docs/cluster.md."""
    return {
        "mem_mb": lambda wildcards, attempt: mem_mb << attempt - 1,
        "runtime": lambda wildcards, attempt: minutes << attempt - 1,
    }


SOLVES = asked(2000, 15)
TELLS = asked(1000, 5)


def declared_scene(wildcards):
    """The fields of a rule's scene in the configuration."""
    return SCENES[wildcards.scene]


def case_files(cases):
    """The files that declare these cases."""
    return [f"manufactured/{case}.yaml" for case in cases]


def scene_case_files(wildcards):
    """The files of the cases of a rule's scene."""
    return case_files(declared_scene(wildcards)["cases"])


def cases_on_polygons(scenes):
    """The files of the cases of an experiment's own scenes."""
    return [file for scene in scenes for file in case_files(scene["cases"])]


@cache
def has_norm(scene):
    """Whether errors of lambda are measured in the dual norm somewhere in a scene."""
    return bool(dual_norm_partitions(SCENES[scene]))


def files_by_rule(scenes):
    """All files of scenes, by the names of the rules that make them."""
    return {
        "dual_norm": expand(rules.dual_norm.output, scene=filter(has_norm, scenes)),
        "solve": expand(rules.solve.output, scene=scenes),
        "rates": expand(rules.rates.output, scene=scenes),
    }


def figure(name, entry=None):
    """The files of a figure, which are in git, and how the report shows it, by its entry in the configuration."""
    return {
        "csv": update(f"figures/{name}.csv"),
        "svg": report(
            update(f"figures/{name}.svg"),
            category="Figures",
            caption="../report/figure.rst",
            labels={"figure": name, "shows": SHOWN[entry or name]["shows"]},
        ),
    }


def paper_figures(paper):
    """The figures that a paper shows."""
    text = Path(paper).read_text(encoding="utf-8")
    return sorted(set(re.findall(r"\]\((figures/\w+\.svg)\)", text)))


def claimed_tables():
    """The tables that the ledger's claims read."""
    names = [
        name.format(scene=scene)
        for claim in read_entries()
        for name in claim.get("reads", ())
        for scene in claim.get("parameters", {}).get("scenes", [""])
    ]
    return sorted(set(names))
