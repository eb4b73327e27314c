# The study: `snakemake -j2` builds everything, `... figures` the figures, `... paper` the paper, `... quick` a trial.
import os

from snakemake.utils import min_version, validate

min_version("9.0")


configfile: "workflow/config/study.yaml"
configfile: "workflow/config/rates.yaml"
configfile: "workflow/config/worst_infsup.yaml"
configfile: "workflow/config/extremes.yaml"


validate(config, "workflow/schemas/study.schema.yaml")

# One thread a job: jobs run side by side, and sums keep their order, so results are byte-identical.
for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ[variable] = "1"


include: "workflow/rules/common.smk"
include: "workflow/rules/scenes.smk"
include: "workflow/rules/surveys.smk"
include: "workflow/rules/sharpness.smk"
include: "workflow/rules/cost.smk"
include: "workflow/rules/extremes.smk"
include: "workflow/rules/figures.smk"
include: "workflow/rules/claims.smk"
include: "workflow/rules/documents.smk"
include: "workflow/rules/paper.smk"


rule all:
    default_target: True
    input:
        expand("results/{scene}/rates.nc", scene=JUDGED),
        expand("results/{scene}/floors.nc", scene=GRIDS),
        FIGURES,
        "results/claims.json",
        "results/cost/work_seconds.svg",
        "README.md",
        rules.paper.output,


rule figures:
    input:
        FIGURES,


rule quick:
    input:
        "results/quick/rates.nc",
