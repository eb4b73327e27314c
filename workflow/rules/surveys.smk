# Lemma 3.1 alone: beta on families of meshes and partitions, without a case.


rule survey:
    input:
        code("survey_infsup"),
    output:
        infsup="results/{survey}/infsup.nc",
    log:
        "results/logs/survey/{survey}.log",
    benchmark:
        "results/benchmarks/survey/{survey}.tsv"
    resources:
        **asked("survey"),
    params:
        study=lambda wildcards: SURVEYS[wildcards.survey],
        finds=lambda wildcards: config["finds"] if SURVEYS[wildcards.survey]["kind"] == "worst" else [],
        name="{survey}",
    message:
        "{wildcards.survey}: beta"
    script:
        "../scripts/survey_infsup.py"
