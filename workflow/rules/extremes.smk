# Where it breaks: the axes in several jobs -> one table.

EXTREMES = config["extremes"]


wildcard_constraints:
    part="|".join(EXTREMES["axes"]),


rule extremes_part:
    input:
        code("try_extremes"),
    output:
        part="results/extremes/parts/{part}.nc",
    log:
        "results/logs/extremes_part/{part}.log",
    params:
        study={key: value for key, value in EXTREMES.items() if key != "axes"},
        axes=lambda wildcards: EXTREMES["axes"][wildcards.part],
    message:
        "extremes: {wildcards.part}"
    script:
        "../scripts/try_extremes.py"


rule extremes:
    input:
        code("collect_extremes"),
        parts=expand("results/extremes/parts/{part}.nc", part=EXTREMES["axes"]),
    output:
        extremes="results/extremes/extremes.nc",
    log:
        "results/logs/extremes.log",
    message:
        "extremes: the table"
    script:
        "../scripts/collect_extremes.py"
