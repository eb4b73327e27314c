# The family lambda ~ s_+^alpha, gap ~ s_-^gamma -> errors and rates, along h/H and along H at one h.


rule sharpness:
    input:
        code("experiments.sharpness.measure"),
    output:
        errors="results/sharpness/errors.nc",
        rates="results/sharpness/rates.nc",
        fixed_errors="results/sharpness/fixed_errors.nc",
        fixed_rates="results/sharpness/fixed_rates.nc",
    log:
        "results/logs/sharpness.log",
    benchmark:
        "results/benchmarks/sharpness.tsv"
    resources:
        **SOLVES,
    params:
        job="experiments.sharpness.measure.measure_sharpness",
        study=config["sharpness"],
        stop=config["stop"],
    message:
        "sharpness: all exponents and positions on all levels"
    script:
        "../scripts/job.py"
