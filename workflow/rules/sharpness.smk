# The family lambda ~ s_+^alpha, gap ~ s_-^gamma -> the tables of errors and of rates.


rule sharpness:
    input:
        code("measure_sharpness"),
    output:
        errors="results/sharpness/errors.nc",
        rates="results/sharpness/rates.nc",
    log:
        "results/logs/sharpness.log",
    benchmark:
        "results/benchmarks/sharpness.tsv"
    resources:
        **asked("sharpness"),
    params:
        study=config["sharpness"],
        stop=config["stop"],
    message:
        "sharpness: all exponents and positions on all levels"
    script:
        "../scripts/measure_sharpness.py"
