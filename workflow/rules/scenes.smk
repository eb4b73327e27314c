# Scene -> coarsest mesh -> a solve per level -> dual norms per partition -> tables -> rates.


rule mesh:
    input:
        library("mesh", "partition", "certificate"),
        "workflow/scripts/scenes.py",
    output:
        "results/{scene}/mesh.vtu",
    params:
        scene=scene_of,
    message:
        "{wildcards.scene}: the coarsest mesh"
    script:
        "../scripts/make_mesh.py"


rule solve:
    input:
        library("sweep", "tables", "certificate"),
        "workflow/scripts/scenes.py",
        case_files,
        mesh="results/{scene}/mesh.vtu",
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


rule dual_norms:
    input:
        library("dual_norm", "tables", "mesh", "certificate"),
        "workflow/scripts/scenes.py",
        case_files,
        solutions=lambda wildcards: expand(
            "results/{scene}/levels/{level}.nc", scene=wildcards.scene, level=levels(wildcards)
        ),
    output:
        "results/{scene}/dual_norms/{partition}.nc",
    params:
        scene=scene_of,
    message:
        "{wildcards.scene}: dual norms on partition {wildcards.partition}"
    script:
        "../scripts/measure_dual_norms.py"


rule errors:
    input:
        library("tables"),
        solutions=lambda wildcards: expand(
            "results/{scene}/levels/{level}.nc", scene=wildcards.scene, level=levels(wildcards)
        ),
        timings=lambda wildcards: expand(
            "results/{scene}/levels/{level}_timings.nc", scene=wildcards.scene, level=levels(wildcards)
        ),
        norms=lambda wildcards: expand(
            "results/{scene}/dual_norms/{partition}.nc",
            scene=wildcards.scene,
            partition=partitions(wildcards),
        ),
    output:
        errors="results/{scene}/errors.nc",
        timings="results/{scene}/timings.nc",
    message:
        "{wildcards.scene}: the table of errors"
    script:
        "../scripts/collect_errors.py"


rule rates:
    input:
        library("rates", "rates_table", "tables", "case"),
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
