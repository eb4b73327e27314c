import re
from functools import cache
from pathlib import Path

from study import registry
from study.documents import numbers, marks
from study.figure_entries import drawings
from study.ledger.entries import entries, files
from study.scenes import normed

SCENES = config["scenes"]
JUDGED = [name for name, scene in SCENES.items() if scene["judged"]]
SURVEYS = config["surveys"]


wildcard_constraints:
    scene="|".join(SCENES),


@cache
def code(*modules):
    """Modules of the study such as manifest, what they import, what that imports, and data files named there.

    The script that runs them is among them. A change of these files reruns the rule's jobs only.
    """
    files, waiting = set(), [Path("workflow/scripts/job.py")]
    for module in modules:
        package, _, name = f"study.{module}".rpartition(".")
        waiting += imports(f"from {package} import {name}")
    while waiting:
        file = waiting.pop()
        if file not in files:
            files.add(file)
            waiting += leads_to(file)
    return sorted(str(file) for file in files if is_there(file))


@cache
def leads_to(file):
    """The data files that a source file names, and where the modules can be that it imports."""
    if file.suffix != ".py" or not is_there(file):
        return []
    source = file.read_text(encoding="utf-8")
    return [file.with_name(name) for name in re.findall(r'"([\w.]+\.yaml)"', source)] + imports(source)


is_there = cache(Path.is_file)


def imports(source):
    """Where the modules can be that a source file imports, at its top or inside functions."""
    found = []
    for module, names in re.findall(
        r"^\s*from ((?:unilateral|study)[\w.]*) import (\([^)]*\)|.+)$", source, re.MULTILINE
    ):
        parts = module.split(".")
        folder = Path("src", *parts)
        packages = [Path("src", *parts[:k]) for k in range(1, len(parts) + 1)]
        inside = [folder / name for name in re.findall(r"\w+", names)]
        found += [folder.with_suffix(".py")]
        found += [each.with_suffix(".py") for each in inside]
        found += [package / "__init__.py" for package in [*packages, *inside]]
    return found


def asked(mem_mb, minutes):
    """What a rule's jobs ask a cluster for, twice that at each further attempt; see docs/cluster.md."""
    return {
        "mem_mb": lambda wildcards, attempt: mem_mb << attempt - 1,
        "runtime": lambda wildcards, attempt: minutes << attempt - 1,
    }


SOLVES = asked(2000, 15)
TELLS = asked(1000, 5)


def scene_of(wildcards):
    return SCENES[wildcards.scene]


def case_files(cases):
    return [f"manufactured/{case}.yaml" for case in cases]


def cases_in(experiment):
    """The files of the cases of an experiment, and of each scene that it has of its own."""
    return [case_files(part.get("cases", [])) for part in (experiment, *experiment.get("scenes", []))]


def examples_in(experiment):
    """The files of its examples, as the argument of that name, where an experiment has any."""
    files = [f"examples/{name}.yaml" for name in experiment.get("examples", [])]
    return {"examples": files} if files else {}


def cases_of(wildcards):
    return case_files(scene_of(wildcards)["cases"])


@cache
def has_norm(scene):
    """Whether errors of lambda are measured in the dual norm somewhere in a scene."""
    return bool(normed(SCENES[scene]))


def files_by_rule(scenes):
    """All files of scenes, by the names of the rules that make them."""
    return {
        "dual_norm": expand(rules.dual_norm.output, scene=filter(has_norm, scenes)),
        "solve": expand(rules.solve.output, scene=scenes),
        "rates": expand(rules.rates.output, scene=scenes),
    }


def job_of(wildcards):
    """The scene and the meshes that a job of the study of cost measures."""
    return config["cost"]["jobs"][int(wildcards.job)]


def pictures(paper):
    """The figures that it shows."""
    text = Path(paper).read_text(encoding="utf-8")
    return sorted(set(re.findall(r"\]\((figures/\w+\.svg)\)", text)))


def claimed():
    """The tables that the ledger's claims read."""
    names = [
        name.format(scene=scene)
        for claim in entries()
        for name in claim.get("reads", ())
        for scene in claim.get("parameters", {}).get("scenes", [""])
    ]
    return sorted(set(names))
