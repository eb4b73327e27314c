# Large meshes by multigrid: a job for each level -> all levels, their rates, and what they took beside what was predicted.

DEEP = config["deep"]
LEVELS = range(len(DEEP["h"]))


wildcard_constraints:
    level="[0-9]+",


rule deep_level:
    input:
        code("measure_deep"),
        case_files(DEEP["cases"]),
    output:
        errors="results/deep/levels/{level}.nc",
        timings="results/deep/levels/{level}_timings.nc",
    log:
        "results/logs/deep_level/{level}.log",
    resources:
        **asked("deep_level"),
    params:
        scene=DEEP,
        h=lambda wildcards: DEEP["h"][int(wildcards.level)],
        stop=config["stop"],
    message:
        "deep: level {wildcards.level}"
    script:
        "../scripts/measure_deep.py"


rule deep_levels:
    input:
        code("collect_deep"),
        case_files(DEEP["cases"]),
        levels=expand("results/deep/levels/{level}.nc", level=LEVELS),
        timed=expand("results/deep/levels/{level}_timings.nc", level=LEVELS),
    output:
        errors="results/deep/errors.nc",
        rates="results/deep/rates.nc",
        timings="results/deep/timings.nc",
    log:
        "results/logs/deep_levels.log",
    resources:
        **asked("deep_levels"),
    params:
        study=config["rates"],
        predicted={
            unit: [resources.predicted(config, "deep_level", {"level": level}, unit) for level in LEVELS]
            for unit in ("mb", "seconds")
        },
    message:
        "deep: all levels"
    script:
        "../scripts/collect_deep.py"
