# Uzawa's algorithm, tried; and the ledger: every statement of the paper judged by the results.


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


rule claims:
    input:
        code("ledger.printed", *registry.checks().values()),
        [f"src/unilateral/study/experiments/{name}/claims.yaml" for name in files()],
        tables=[f"results/{name}.nc" for name in claimed()],
    output:
        claims="results/claims.json",
    log:
        "results/logs/claims.log",
    resources:
        **TELLS,
    params:
        job="ledger.printed.judge_claims",
    message:
        "The ledger: every statement judged"
    script:
        "../scripts/job.py"
