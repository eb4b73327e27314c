# The family lambda ~ s_+^alpha, gap ~ s_-^gamma: a level per job -> the tables of errors and of rates.


rule sharpness_level:
    input:
        code("measure_sharpness"),
    output:
        errors="results/sharpness/levels/{level}.nc",
    log:
        "results/logs/sharpness_level/{level}.log",
    params:
        study={key: value for key, value in SHARPNESS.items() if key != "H"},
        stop=config["stop"],
        H=lambda wildcards: SHARPNESS["H"][int(wildcards.level)],
    message:
        "sharpness: all exponents and positions on level {wildcards.level}"
    script:
        "../scripts/measure_sharpness.py"


rule sharpness:
    input:
        code("collect_sharpness"),
        levels=expand("results/sharpness/levels/{level}.nc", level=range(len(SHARPNESS["H"]))),
    output:
        errors="results/sharpness/errors.nc",
        rates="results/sharpness/rates.nc",
    log:
        "results/logs/sharpness.log",
    message:
        "sharpness: errors, and rates over the exponents"
    script:
        "../scripts/collect_sharpness.py"
