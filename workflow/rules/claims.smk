# The ledger: every statement of the paper judged by the results.


rule claims:
    input:
        code("ledger.reports", *registry.checks().values()),
        [f"src/study/experiments/{name}/claims.yaml" for name in files()],
        tables=[f"results/{name}.nc" for name in claimed()],
    output:
        claims="results/claims.json",
    log:
        "results/logs/claims.log",
    resources:
        **TELLS,
    params:
        job="ledger.reports.judge_claims",
    message:
        "The ledger: every statement judged"
    script:
        "../scripts/job.py"
