# Uzawa's algorithm, tried; and the ledger: every statement of the paper judged by the results.


rule algorithm:
    input:
        code("try_algorithm"),
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
        study=config["algorithm"],
    message:
        "Uzawa's algorithm with steps inside and outside its range"
    script:
        "../scripts/try_algorithm.py"


rule claims:
    input:
        code("judge_claims"),
        [code("judge_claims", f"study.{module}") for module in registry.checks().values()],
        [f"src/unilateral/study/experiments/{name}/claims.yaml" for name in files()],
        tables=[f"results/{name}.nc" for name in claimed()],
    output:
        claims="results/claims.json",
    log:
        "results/logs/claims.log",
    resources:
        **TELLS,
    message:
        "The ledger: every statement judged"
    script:
        "../scripts/judge_claims.py"
