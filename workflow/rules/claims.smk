# The ledger: every statement of the paper judged by the results.


rule claims:
    input:
        sorted(map(str, Path().glob("src/study/experiments/*/claims.yaml"))),
        tables=[f"results/{name}.nc" for name in claimed_tables()],
    output:
        claims="results/claims.json",
    log:
        "results/logs/claims.log",
    benchmark:
        "results/benchmarks/claims.tsv"
    resources:
        **TELLS,
    params:
        code=code("claims"),
    message:
        "The ledger: every statement judged"
    script:
        "../scripts/claims.py"
