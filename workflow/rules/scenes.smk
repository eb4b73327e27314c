# Scene -> coarsest mesh, and the dual norm -> a solve per level -> tables -> rates.


rule mesh:
    input:
        code("make_mesh"),
    output:
        "results/{scene}/mesh.vtu",
    params:
        scene=scene_of,
    message:
        "{wildcards.scene}: the coarsest mesh"
    script:
        "../scripts/make_mesh.py"


rule dual_norm:
    input:
        code("measure_dual_norm"),
        case_files,
    output:
        "results/{scene}/dual_norm.nc",
    params:
        scene=scene_of,
    message:
        "{wildcards.scene}: the dual norm"
    script:
        "../scripts/measure_dual_norm.py"


rule solve:
    input:
        code("solve_level"),
        case_files,
        mesh="results/{scene}/mesh.vtu",
        norm=lambda wildcards: f"results/{wildcards.scene}/dual_norm.nc" if has_norm(wildcards.scene) else [],
    output:
        solutions="results/{scene}/levels/{level}.nc",
        timings="results/{scene}/levels/{level}_timings.nc",
    params:
        scene=scene_of,
        stop=config["stop"],
    message:
        "{wildcards.scene}: all cases on level {wildcards.level}"
    script:
        "../scripts/solve_level.py"


rule errors:
    input:
        code("collect_errors"),
        solutions=lambda wildcards: expand(
            "results/{scene}/levels/{level}.nc", scene=wildcards.scene, level=levels(wildcards)
        ),
        timings=lambda wildcards: expand(
            "results/{scene}/levels/{level}_timings.nc", scene=wildcards.scene, level=levels(wildcards)
        ),
    output:
        errors="results/{scene}/errors.nc",
        infsup="results/{scene}/infsup.nc",
        timings="results/{scene}/timings.nc",
    message:
        "{wildcards.scene}: the table of errors"
    script:
        "../scripts/collect_errors.py"


rule rates:
    input:
        code("judge_rates"),
        case_files,
        errors="results/{scene}/errors.nc",
    output:
        "results/{scene}/rates.nc",
    params:
        rates=config["rates"],
        judged=lambda wildcards: scene_of(wildcards)["judged"],
    message:
        "{wildcards.scene}: rates, judged"
    script:
        "../scripts/judge_rates.py"


rule totals:
    input:
        code("bound_totals"),
        case_files,
        mesh="results/{scene}/mesh.vtu",
        levels=expand("results/{{scene}}/levels/{level}.nc", level=range(config["totals"]["levels"])),
    output:
        "results/{scene}/totals.nc",
    params:
        scene=scene_of,
        cases=lambda wildcards: config["totals"]["scenes"][wildcards.scene],
        ratio=config["rates"]["judged_ratio"],
    message:
        "{wildcards.scene}: the guaranteed total errors"
    script:
        "../scripts/bound_totals.py"


rule floors:
    input:
        code("fit_floors"),
        case_files,
        errors="results/{scene}/errors.nc",
    output:
        "results/{scene}/floors.nc",
    params:
        ratio=config["rates"]["judged_ratio"],
    message:
        "{wildcards.scene}: the floors that h and H leave in H1"
    script:
        "../scripts/fit_floors.py"
