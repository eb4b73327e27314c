# The study: `snakemake -j2` builds everything, `... figures` the figures, `... paper` the paper, `... quick` a trial.
import fcntl
import os
import sys
from contextlib import suppress

import numpy
from snakemake.utils import min_version, update_config

from study import config as configuration
from unilateral.errors import InputError

min_version("9.0")

PARAMETERS = [
    f"workflow/config/{name}.yaml" for name in ("study", "rates", "worst_infsup", "extremes", "figures")
]

try:
    fields, sources = configuration.read_configuration(PARAMETERS)
    update_config(fields, config)  # by what the option --config says
    configuration.check(fields, sources, "workflow/schemas/study.schema.yaml")
except InputError as fault:
    print(f"unilateral: {fault}", file=sys.stderr)
    sys.exit(fault.exit_code)
config = fields

# Held as long as a process of this run lives: so workflow/resume.py knows whether one does.
ALIVE = open("Snakefile", encoding="utf-8")
with suppress(OSError):  # some shared file systems have no locks
    fcntl.flock(ALIVE, fcntl.LOCK_SH)

# One thread a job: jobs run side by side, and sums keep their order.
for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ[variable] = "1"
# Code for AVX2 where a processor has it, and no wider one: other code sums in another order, and differs in the
# last digits. So two runs give the same bytes on most processors.
FEATURES = numpy.show_config(mode="dicts")["SIMD Extensions"].get("found", [])
if "X86_V3" in FEATURES:
    os.environ.update(OPENBLAS_CORETYPE="Haswell")
    # None is found where this file is read by a job of a run that has done this
    if WIDER_FEATURES := [name for name in FEATURES if name != "X86_V3"]:
        os.environ.update(NPY_DISABLE_CPU_FEATURES=" ".join(WIDER_FEATURES))


include: "workflow/rules/common.smk"
include: "workflow/rules/scenes.smk"
include: "workflow/rules/experiments.smk"
include: "workflow/rules/cost.smk"
include: "workflow/rules/figures.smk"
include: "workflow/rules/claims.smk"
include: "workflow/rules/documents.smk"
include: "workflow/rules/paper.smk"
include: "workflow/rules/manifest.smk"
include: "workflow/rules/report.smk"


rule all:
    default_target: True
    input:
        *MADE.values(),
        rules.manifest.output,
        rules.pages.output,
        rules.curves.output,


rule figures:
    input:
        FIGURES,


rule paper:
    input:
        expand(rules.typeset.output, paper=PAPERS),


rule quick:
    input:
        *files_by_rule(["quick"]).values(),
