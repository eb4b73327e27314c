import re
from pathlib import Path

SCENES = config["scenes"]
JUDGED = [name for name, scene in SCENES.items() if scene["judged"]]
PORTRAITS = config["portraits"]


wildcard_constraints:
    scene="[a-z][a-z0-9]*",
    level="[0-9]+",
    partition="[0-9]+",


def library(*modules):
    """The files of the library's modules and of all they import, so that a change in one reruns its users only."""
    files = {}
    waiting = [f"src/unilateral/{module}.py" for module in ("__init__", *modules)]
    while waiting:
        file = waiting.pop()
        if file in files or not Path(file).exists():
            continue
        files[file] = None
        text = Path(file).read_text(encoding="utf-8")
        imported = re.findall(r"^\s*from unilateral(?:\.(\w+))? import (.+)$", text, re.MULTILINE)
        names = [module for module, _ in imported if module]
        names += [
            word.split(" as ")[0].strip()
            for module, words in imported
            if not module
            for word in words.split(",")
        ]
        waiting += [f"src/unilateral/{name}.py" for name in names]
    return sorted(files)


def scene_of(wildcards):
    return SCENES[wildcards.scene]


def case_files(wildcards):
    return [f"manufactured/{case}.yaml" for case in scene_of(wildcards)["cases"]]


def levels(wildcards):
    return range(scene_of(wildcards)["mesh"]["levels"])


def partitions(wildcards):
    return range(len(scene_of(wildcards)["H"]))
