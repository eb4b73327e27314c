# Scene -> coarsest mesh, and the dual norm -> a solve per level -> tables -> rates.


rule mesh:
    input:
        code("make_mesh"),
    output:
        mesh="results/{scene}/mesh.vtu",
    log:
        "results/logs/mesh/{scene}.log",
    params:
        scene=scene_of,
    message:
        "{wildcards.scene}: the coarsest mesh"
    script:
        "../scripts/make_mesh.py"


rule dual_norm:
    input:
        code("measure_dual_norm"),
        cases_of,
    output:
        dual_norm="results/{scene}/dual_norm.nc",
    log:
        "results/logs/dual_norm/{scene}.log",
    params:
        scene=scene_of,
        name="{scene}",
    message:
        "{wildcards.scene}: the dual norm"
    script:
        "../scripts/measure_dual_norm.py"


rule solve:
    input:
        code("solve_level"),
        cases_of,
        mesh="results/{scene}/mesh.vtu",
        norm=lambda wildcards: f"results/{wildcards.scene}/dual_norm.nc" if has_norm(wildcards.scene) else [],
    output:
        solutions="results/{scene}/levels/{level}.nc",
        timings="results/{scene}/levels/{level}_timings.nc",
    log:
        "results/logs/solve/{scene}/{level}.log",
    params:
        scene=scene_of,
        name="{scene}",
        level=lambda wildcards: int(wildcards.level),
        stop=config["stop"],
    message:
        "{wildcards.scene}: all cases on level {wildcards.level}"
    script:
        "../scripts/solve_level.py"


rule errors:
    input:
        code("collect_errors"),
        solutions=levels_of("results/{scene}/levels/{level}.nc"),
        timed=levels_of("results/{scene}/levels/{level}_timings.nc"),
    output:
        errors="results/{scene}/errors.nc",
        infsup="results/{scene}/infsup.nc",
        timings="results/{scene}/timings.nc",
    log:
        "results/logs/errors/{scene}.log",
    params:
        name="{scene}",
    message:
        "{wildcards.scene}: the table of errors"
    script:
        "../scripts/collect_errors.py"


rule rates:
    input:
        code("judge_rates"),
        cases_of,
        errors="results/{scene}/errors.nc",
    output:
        rates="results/{scene}/rates.nc",
    log:
        "results/logs/rates/{scene}.log",
    params:
        name="{scene}",
        study=config["rates"],
        judged=lambda wildcards: scene_of(wildcards)["judged"],
    message:
        "{wildcards.scene}: rates, judged"
    script:
        "../scripts/judge_rates.py"


rule totals:
    input:
        code("bound_totals"),
        cases_of,
        mesh="results/{scene}/mesh.vtu",
        levels=expand("results/{{scene}}/levels/{level}.nc", level=range(config["totals"]["levels"])),
    output:
        totals="results/{scene}/totals.nc",
    log:
        "results/logs/totals/{scene}.log",
    params:
        scene=scene_of,
        name="{scene}",
        wanted=lambda wildcards: config["totals"]["scenes"][wildcards.scene],
        ratio=config["rates"]["judged_ratio"],
    message:
        "{wildcards.scene}: the guaranteed total errors"
    script:
        "../scripts/bound_totals.py"


rule floors:
    input:
        code("fit_floors"),
        cases_of,
        errors="results/{scene}/errors.nc",
    output:
        floors="results/{scene}/floors.nc",
    log:
        "results/logs/floors/{scene}.log",
    params:
        name="{scene}",
        ratio=config["rates"]["judged_ratio"],
    message:
        "{wildcards.scene}: the floors that h and H leave in H1"
    script:
        "../scripts/fit_floors.py"
