import math
import re
from fractions import Fraction
from pathlib import Path

import yaml

SCENES = config["scenes"]
JUDGED = [name for name, scene in SCENES.items() if scene["judged"]]
GRIDS = [name for name, scene in SCENES.items() if "grid" in scene["figures"]]
PORTRAITS = config["portraits"]
SURVEYS = config["surveys"]
SHARPNESS = config["sharpness"]
CONSISTENCY = config["consistency"]


wildcard_constraints:
    scene="|".join(SCENES),
    survey="|".join(SURVEYS),
    level="[0-9]+",


def library(*modules):
    """The files of the library's modules, of all they import and read: a change reruns their users only."""
    files = []
    waiting = ["__init__", *modules]
    while waiting:
        path = Path("src/unilateral", waiting.pop())
        for file in [path.with_suffix(".py"), *sorted(path.glob("*.py"))]:
            if file.exists() and str(file) not in files:
                source = file.read_text(encoding="utf-8")
                files += [str(file), *data(source)]
                waiting += imports(source)
    return sorted(set(files))


def data(source):
    """The library's data files that a source file reads."""
    names = re.findall(r'files\("unilateral"\) / "([\w.]+)"', source)
    return [f"src/unilateral/{name}" for name in names]


def imports(source):
    """The library's modules that a source file imports, at its top or inside functions."""
    found = re.findall(r"^\s*from unilateral(?:\.(\w+)\S*)? import (.+)$", source, re.MULTILINE)
    return [name for inside, names in found for name in ([inside] if inside else re.findall(r"\w+", names))]


def scene_of(wildcards):
    return SCENES[wildcards.scene]


def case_files(wildcards):
    return [f"manufactured/{case}.yaml" for case in scene_of(wildcards)["cases"]]


def with_cases(scene, cases):
    """The scene with these cases only."""
    return {**SCENES[scene], "cases": cases}


def levels(wildcards):
    return range(scene_of(wildcards)["mesh"]["levels"])


def normed(wildcards):
    return normed_of(wildcards.scene)


def normed_of(name):
    """The partitions with errors of lambda: those coarser than the finest mesh (else beta is 0) and solved."""
    scene = SCENES[name]
    coarsest = number(scene["mesh"]["h"])
    finest = coarsest / 2 ** (scene["mesh"]["levels"] - 1)
    most = number(scene["H_over_h"]["max"]) * coarsest if "max" in scene["H_over_h"] else math.inf
    return [k for k, H in enumerate(scene["H"]) if finest < number(H) <= most]


def claimed():
    """The tables that the ledger's claims read."""
    with open("src/unilateral/ledger.yaml", encoding="utf-8") as file:
        claims = yaml.safe_load(file)["claims"]
    names = [
        name.format(scene=scene)
        for claim in claims
        for name in claim["reads"]
        for scene in claim.get("parameters", {}).get("scenes", [""])
    ]
    return sorted(set(names))


def number(given):
    """Exactly what the schema calls a number: 0.125, 1/64, 0.5/4."""
    top, _, bottom = str(given).partition("/")
    return Fraction(top) / Fraction(bottom or 1)
