# Lemma 3.1 alone: beta on families of meshes and partitions, without a case.


rule survey:
    input:
        code("survey_infsup"),
    output:
        "results/{survey}/infsup.nc",
    params:
        survey=lambda wildcards: SURVEYS[wildcards.survey],
        finds=lambda wildcards: config["finds"] if SURVEYS[wildcards.survey]["kind"] == "worst" else [],
    message:
        "{wildcards.survey}: beta"
    script:
        "../scripts/survey_infsup.py"
