"""The study's configuration, changed in one place, and what is said of it."""

import copy
from functools import reduce
from pathlib import Path

from conftest import ROOT

from study import config as configuration
from unilateral.errors import InputError

SCHEMA = str(ROOT / "workflow/schemas/study.schema.yaml")
FILES = [f"workflow/config/{name}.yaml" for name in ("study", "rates", "worst_infsup", "extremes", "figures")]
WHOLE, READ = configuration.read_configuration([str(ROOT / file) for file in FILES])
SOURCES = {name: str(Path(file).relative_to(ROOT)) for name, file in READ.items()}
SOURCE = r"([\w./, ]+\.yaml|the option --config)"
"""Where a message says that a field is from."""
STUDY = {**WHOLE, "finds": {survey: finds[:1] for survey, finds in WHOLE["finds"].items()}}
"""One pair for each survey: the others are of the same form, and take half of the time of a check."""
REMOVED = object()


def fault(study):
    """What is said of a configuration, or None."""
    try:
        configuration.check(study, SOURCES, SCHEMA)
    except InputError as error:
        return str(error)
    return None


def parent(study, place):
    """The mapping or list that has that place in it."""
    return reduce(lambda branch, key: branch[key], place[:-1], study)


def change_study(path, value):
    """The study with another value at a path."""
    study = copy.deepcopy(STUDY)
    place = path.split(".", 1 + path.count(".") * (".." not in path)) if isinstance(path, str) else [path]
    if value is REMOVED:
        del parent(study, place)[place[-1]]
    else:
        parent(study, place)[place[-1]] = value
    return study
