# Uniform meshes beside adapted ones -> errors and bounds, level by level, their rates, and beta.

ADAPTIVE = config["adaptive"]


rule adaptive:
    input:
        code("experiments.adaptive.measure"),
        [case_files(scene["cases"]) for scene in ADAPTIVE["scenes"]],
        examples=[f"examples/{name}.yaml" for name in ADAPTIVE["examples"]],
    output:
        errors="results/adaptive/errors.nc",
        infsup="results/adaptive/infsup.nc",
        timings="results/adaptive/timings.nc",
        rates="results/adaptive/rates.nc",
    log:
        "results/logs/adaptive.log",
    benchmark:
        "results/benchmarks/adaptive.tsv"
    resources:
        **SOLVES,
    params:
        job="experiments.adaptive.measure.measure_adaptive",
        study=ADAPTIVE,
        stop=config["stop"],
    message:
        "adaptive: all problems on uniform and on adapted meshes"
    script:
        "../scripts/job.py"
