# Where it breaks: the axes in several jobs -> one table; and, on request only, the finest h.
EXTREMES = config["extremes"]


wildcard_constraints:
    part="|".join(EXTREMES["jobs"]),


rule extremes_part:
    input:
        code("try_extremes"),
    output:
        part="results/extremes/parts/{part}.nc",
    log:
        "results/logs/extremes_part/{part}.log",
    params:
        study={key: value for key, value in EXTREMES.items() if key not in ("axes", "jobs")},
        axes=lambda wildcards: {name: EXTREMES["axes"][name] for name in EXTREMES["jobs"][wildcards.part]},
    message:
        "extremes: {wildcards.part}"
    script:
        "../scripts/try_extremes.py"


rule extremes:
    input:
        code("collect_extremes"),
        parts=expand("results/extremes/parts/{part}.nc", part=EXTREMES["jobs"]),
    output:
        extremes="results/extremes/extremes.nc",
    log:
        "results/logs/extremes.log",
    message:
        "extremes: the table"
    script:
        "../scripts/collect_extremes.py"
