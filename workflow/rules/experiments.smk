# Experiments of their own: their fields of the configuration -> their tables.

# What measures an experiment, its tables, and the fields of the configuration that it is given beside its own.
EXPERIMENTS = {
    "adaptive": ("measure.measure_adaptive", ["errors", "infsup", "timings", "rates"], ["stop"]),
    "algorithm": (
        "tables.try_algorithm",
        ["steps", "certificates", "singular", "uniqueness", "unique", "elimination", "split", "formulation"],
        [],
    ),
    "cells": ("measure.measure_cells", ["errors", "alternating"], ["stop"]),
    "certify": ("measure.measure_certify", ["solutions"], []),
    "extremes": ("measure.try_extremes", ["extremes"], []),
    "graded": ("measure.measure_graded", ["errors", "adapted"], ["stop"]),
    "sharpness": (
        "measure.measure_sharpness",
        ["errors", "rates", "fixed_errors", "fixed_rates"],
        ["stop"],
    ),
}


for name, (job, tables, others) in EXPERIMENTS.items():

    rule:
        name:
            name
        input:
            code(f"experiments.{name}.{job.rpartition('.')[0]}"),
            cases_in(config[name]),
            **examples_in(config[name]),
        output:
            **{table: f"results/{name}/{table}.nc" for table in tables},
        log:
            f"results/logs/{name}.log",
        benchmark:
            f"results/benchmarks/{name}.tsv"
        resources:
            **SOLVES,
        params:
            **{other: config[other] for other in others},
            job=f"experiments.{name}.{job}",
            study=config[name],
        message:
            f"{name}: all of its tables"
        script:
            "../scripts/job.py"


rule surveys:
    input:
        code("experiments.stability.measure"),
    output:
        tables=expand("results/{survey}/infsup.nc", survey=SURVEYS),
    log:
        "results/logs/surveys.log",
    benchmark:
        "results/benchmarks/surveys.tsv"
    resources:
        **SOLVES,
    params:
        job="experiments.stability.measure.survey_infsup",
        study=SURVEYS,
        finds=config["finds"],
    message:
        "surveys: beta"
    script:
        "../scripts/job.py"
