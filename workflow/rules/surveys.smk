# Lemma 3.1 alone: beta on families of meshes and partitions, without a case.


rule surveys:
    input:
        code("experiments.stability.measure"),
    output:
        tables=expand("results/{survey}/infsup.nc", survey=SURVEYS),
    log:
        "results/logs/surveys.log",
    benchmark:
        "results/benchmarks/surveys.tsv"
    resources:
        **SOLVES,
    params:
        job="experiments.stability.measure.survey_infsup",
        study=SURVEYS,
        finds=config["finds"],
    message:
        "surveys: beta"
    script:
        "../scripts/job.py"
