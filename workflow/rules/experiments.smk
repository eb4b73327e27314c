# Experiments of their own, a rule each: their fields of the configuration -> their tables.

ADAPTIVE = config["adaptive"]


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


rule sharpness:
    input:
        code("experiments.sharpness.measure"),
    output:
        errors="results/sharpness/errors.nc",
        rates="results/sharpness/rates.nc",
        fixed_errors="results/sharpness/fixed_errors.nc",
        fixed_rates="results/sharpness/fixed_rates.nc",
    log:
        "results/logs/sharpness.log",
    benchmark:
        "results/benchmarks/sharpness.tsv"
    resources:
        **SOLVES,
    params:
        job="experiments.sharpness.measure.measure_sharpness",
        study=config["sharpness"],
        stop=config["stop"],
    message:
        "sharpness: all exponents and positions on all levels"
    script:
        "../scripts/job.py"


rule cells:
    input:
        code("experiments.cells.measure"),
        case_files(config["cells"]["cases"]),
    output:
        errors="results/cells/errors.nc",
        alternating="results/cells/alternating.nc",
    log:
        "results/logs/cells.log",
    resources:
        **SOLVES,
    params:
        job="experiments.cells.measure.measure_cells",
        study=config["cells"],
        stop=config["stop"],
    message:
        "cells: infinitely many transitions, on cells of many sizes"
    script:
        "../scripts/job.py"


rule adaptive:
    input:
        code("experiments.adaptive.measure"),
        [case_files(scene["cases"]) for scene in ADAPTIVE["scenes"]],
        examples=[f"examples/{name}.yaml" for name in ADAPTIVE["examples"]],
    output:
        errors="results/adaptive/errors.nc",
        infsup="results/adaptive/infsup.nc",
        timings="results/adaptive/timings.nc",
        rates="results/adaptive/rates.nc",
    log:
        "results/logs/adaptive.log",
    benchmark:
        "results/benchmarks/adaptive.tsv"
    resources:
        **SOLVES,
    params:
        job="experiments.adaptive.measure.measure_adaptive",
        study=ADAPTIVE,
        stop=config["stop"],
    message:
        "adaptive: all problems on uniform and on adapted meshes"
    script:
        "../scripts/job.py"


rule algorithm:
    input:
        code("experiments.algorithm.tables"),
        case_files(config["algorithm"]["cases"]),
    output:
        steps="results/algorithm/steps.nc",
        certificates="results/algorithm/certificates.nc",
        singular="results/algorithm/singular.nc",
        uniqueness="results/algorithm/uniqueness.nc",
        unique="results/algorithm/unique.nc",
        elimination="results/algorithm/elimination.nc",
        split="results/algorithm/split.nc",
        formulation="results/algorithm/formulation.nc",
    log:
        "results/logs/algorithm.log",
    resources:
        **SOLVES,
    params:
        job="experiments.algorithm.tables.try_algorithm",
        study=config["algorithm"],
    message:
        "Uzawa's algorithm with steps inside and outside its range"
    script:
        "../scripts/job.py"


rule extremes:
    input:
        code("experiments.extremes.measure"),
    output:
        extremes="results/extremes/extremes.nc",
    log:
        "results/logs/extremes.log",
    benchmark:
        "results/benchmarks/extremes.tsv"
    resources:
        **SOLVES,
    params:
        job="experiments.extremes.measure.try_extremes",
        study=config["extremes"],
    message:
        "extremes: all axes"
    script:
        "../scripts/job.py"
