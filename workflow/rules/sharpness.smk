# The family lambda ~ s_+^alpha, gap ~ s_-^gamma: a level per job -> the table -> rates over the exponents.


rule sharpness_level:
    input:
        code("measure_sharpness"),
    output:
        "results/sharpness/levels/{level}.nc",
    params:
        study=SHARPNESS,
        stop=config["stop"],
    message:
        "sharpness: all exponents and positions on level {wildcards.level}"
    script:
        "../scripts/measure_sharpness.py"


rule sharpness:
    input:
        code("collect_sharpness"),
        levels=expand("results/sharpness/levels/{level}.nc", level=range(len(SHARPNESS["H"]))),
    output:
        "results/sharpness/errors.nc",
    message:
        "sharpness: the table of errors"
    script:
        "../scripts/collect_sharpness.py"


rule sharpness_rates:
    input:
        code("rate_sharpness"),
        errors="results/sharpness/errors.nc",
    output:
        "results/sharpness/rates.nc",
    message:
        "sharpness: rates over the exponents"
    script:
        "../scripts/rate_sharpness.py"
