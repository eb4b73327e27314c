# Where it breaks: all axes of extreme problems.


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
