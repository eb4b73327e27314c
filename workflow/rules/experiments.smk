# Experiments of their own: their fields of the configuration -> their tables.
#
# Those that take longest have a priority: where they start last, a core waits for them with nothing to do.


rule adaptive:
    input:
        cases_on_polygons(config["adaptive"]["scenes"]),
        examples=expand("examples/{name}.yaml", name=config["adaptive"]["examples"]),
    output:
        errors="results/adaptive/errors.nc",
        infsup="results/adaptive/infsup.nc",
        timings="results/adaptive/timings.nc",
        rates="results/adaptive/rates.nc",
    log:
        "results/logs/adaptive.log",
    benchmark:
        "results/benchmarks/adaptive.tsv"
    priority: 1
    resources:
        **SOLVES,
    params:
        study=config["adaptive"],
        stop=config["stop"],
        code=code("adaptive"),
    message:
        "adaptive: uniform meshes beside adapted ones"
    script:
        "../scripts/adaptive.py"


rule algorithm:
    input:
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
    benchmark:
        "results/benchmarks/algorithm.tsv"
    resources:
        **SOLVES,
    params:
        study=config["algorithm"],
        code=code("algorithm"),
    message:
        "algorithm: Uzawa's algorithm, tried"
    script:
        "../scripts/algorithm.py"


rule cells:
    input:
        case_files(config["cells"]["cases"]),
    output:
        errors="results/cells/errors.nc",
        alternating="results/cells/alternating.nc",
    log:
        "results/logs/cells.log",
    benchmark:
        "results/benchmarks/cells.tsv"
    resources:
        **SOLVES,
    params:
        study=config["cells"],
        stop=config["stop"],
        code=code("cells"),
    message:
        "cells: what the size of the cells alone does"
    script:
        "../scripts/cells.py"


rule certain:
    input:
        cases_on_polygons(config["certain"]["scenes"]),
    output:
        contact="results/certain/contact.nc",
    log:
        "results/logs/certain.log",
    benchmark:
        "results/benchmarks/certain.tsv"
    resources:
        **SOLVES,
    params:
        study=config["certain"],
        code=code("certain"),
    message:
        "certain: what is certain of contact, against exact contact sets"
    script:
        "../scripts/certain.py"


rule certify:
    input:
        cases_on_polygons(config["certify"]["scenes"]),
    output:
        solutions="results/certify/solutions.nc",
    log:
        "results/logs/certify.log",
    benchmark:
        "results/benchmarks/certify.tsv"
    resources:
        **SOLVES,
    params:
        study=config["certify"],
        code=code("certify"),
    message:
        "certify: bounds for solutions of other methods"
    script:
        "../scripts/certify.py"


rule multipliers:
    input:
        cases_on_polygons(config["multipliers"]["scenes"]),
    output:
        errors="results/multipliers/errors.nc",
    log:
        "results/logs/multipliers.log",
    benchmark:
        "results/benchmarks/multipliers.tsv"
    resources:
        **SOLVES,
    params:
        study=config["multipliers"],
        code=code("multipliers"),
    message:
        "multipliers: errors of lambda by other methods on the same meshes"
    script:
        "../scripts/multipliers.py"


rule extremes:
    output:
        extremes="results/extremes/extremes.nc",
        reaction="results/extremes/reaction.nc",
        neighbours="results/extremes/neighbours.nc",
    log:
        "results/logs/extremes.log",
    benchmark:
        "results/benchmarks/extremes.tsv"
    priority: 1
    resources:
        **SOLVES,
    params:
        study=config["extremes"],
        code=code("extremes"),
    message:
        "extremes: where algorithms fail, how sharp bounds are over c/k, and the work at neighbouring sizes"
    script:
        "../scripts/extremes.py"


rule graded:
    input:
        cases_on_polygons(config["graded"]["scenes"]),
    output:
        errors="results/graded/errors.nc",
        adapted="results/graded/adapted.nc",
    log:
        "results/logs/graded.log",
    benchmark:
        "results/benchmarks/graded.tsv"
    resources:
        **SOLVES,
    params:
        study=config["graded"],
        stop=config["stop"],
        code=code("graded"),
    message:
        "graded: meshes graded to a vertex"
    script:
        "../scripts/graded.py"


rule sharpness:
    output:
        errors="results/sharpness/errors.nc",
        rates="results/sharpness/rates.nc",
        fixed_errors="results/sharpness/fixed_errors.nc",
        fixed_rates="results/sharpness/fixed_rates.nc",
    log:
        "results/logs/sharpness.log",
    benchmark:
        "results/benchmarks/sharpness.tsv"
    priority: 1
    resources:
        **SOLVES,
    params:
        study=config["sharpness"],
        stop=config["stop"],
        code=code("sharpness"),
    message:
        "sharpness: rates at transitions of all exponents"
    script:
        "../scripts/sharpness.py"


rule surveys:
    output:
        tables=expand("results/{survey}/infsup.nc", survey=SURVEYS),
    log:
        "results/logs/surveys.log",
    benchmark:
        "results/benchmarks/surveys.tsv"
    priority: 1
    resources:
        **SOLVES,
    params:
        study=SURVEYS,
        finds=config["finds"],
        code=code("surveys"),
    message:
        "surveys: beta"
    script:
        "../scripts/surveys.py"
