import re
from functools import cache
from pathlib import Path

import yaml

from unilateral.study.drawings import drawings, shown
from unilateral.study.sizes import normed

SCENES = config["scenes"]
JUDGED = [name for name, scene in SCENES.items() if scene["judged"]]
SURVEYS = config["surveys"]
SHARPNESS = config["sharpness"]


wildcard_constraints:
    scene="|".join(SCENES),
    survey="|".join(SURVEYS),
    level="[0-9]+",


@cache
def code(script, module=""):
    """A script, what it imports of this project, what that imports, and the data files that are named there.

    A change of these files reruns the script's rule only. A script that imports a module of the library by
    its name, such as study.figures.rates, depends on that module too.
    """
    package, _, name = module.rpartition(".")
    files, waiting = set(), [Path("workflow/scripts", f"{script}.py")]
    waiting += imports(f"from unilateral.{package} import {name}") if module else []
    while waiting:
        file = waiting.pop()
        if file not in files and file.is_file():
            files.add(file)
            source = file.read_text(encoding="utf-8")
            files |= {file.with_name(name) for name in re.findall(r'"([\w.]+\.yaml)"', source)}
            waiting += imports(source)
    return sorted(str(file) for file in files if file.is_file())


def imports(source):
    """Where the modules can be that a source file imports, at its top or inside functions."""
    found = []
    for module, names in re.findall(r"^\s*from ([\w.]+) import (\([^)]*\)|.+)$", source, re.MULTILINE):
        inside, *parts = module.split(".")
        if inside != "unilateral":
            found.append(Path("workflow/scripts", f"{inside}.py"))
            continue
        folder = Path("src/unilateral", *parts)
        packages = [Path("src/unilateral", *parts[:k]) for k in range(len(parts) + 1)]
        inside = [folder / name for name in re.findall(r"\w+", names)]
        found += [folder.with_suffix(".py")] if parts else []
        found += [each.with_suffix(".py") for each in inside]
        found += [package / "__init__.py" for package in [*packages, *inside]]
    return found


def scene_of(wildcards):
    return SCENES[wildcards.scene]


def case_files(cases):
    return [f"manufactured/{case}.yaml" for case in cases]


def cases_of(wildcards):
    return case_files(scene_of(wildcards)["cases"])


def levels_of(path):
    """The files of all levels of a scene, as a function of its wildcards."""
    return lambda wildcards: expand(
        path, scene=wildcards.scene, level=range(scene_of(wildcards)["mesh"]["levels"])
    )


@cache
def has_norm(scene):
    """Whether errors of lambda are measured in the dual norm somewhere in a scene."""
    return bool(normed(SCENES[scene]))


def results_of(scene):
    """All files of a scene."""
    made = [rules.mesh, rules.solve, rules.errors, rules.rates]
    made += [rules.dual_norm] if has_norm(scene) else []
    paths = [path for rule in made for path in rule.output]
    return expand(paths, scene=scene, level=range(SCENES[scene]["mesh"]["levels"]))


def job_of(wildcards):
    """The scene and the meshes that a job of the study of cost measures."""
    return config["cost"]["jobs"][int(wildcards.job)]


def pictures(paper):
    """The figures that it shows."""
    text = Path(paper).read_text(encoding="utf-8")
    return sorted(set(re.findall(r"\]\((figures/\w+\.svg)\)", text)))


def claimed():
    """The tables that the ledger's claims read."""
    with open("src/unilateral/study/judge/ledger.yaml", encoding="utf-8") as file:
        claims = yaml.safe_load(file)["claims"]
    names = [
        name.format(scene=scene)
        for claim in claims
        for name in claim["reads"]
        for scene in claim.get("parameters", {}).get("scenes", [""])
    ]
    return sorted(set(names))
