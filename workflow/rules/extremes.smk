# Where it breaks: all axes of extreme problems.


rule extremes:
    input:
        code("try_extremes"),
    output:
        extremes="results/extremes/extremes.nc",
    log:
        "results/logs/extremes.log",
    benchmark:
        "results/benchmarks/extremes.tsv"
    resources:
        **SOLVES,
    params:
        study=config["extremes"],
    message:
        "extremes: all axes"
    script:
        "../scripts/try_extremes.py"
