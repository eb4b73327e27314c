# Scene -> the dual norm -> a solve of all levels, with its tables -> rates.


rule dual_norm:
    input:
        scene_case_files,
    output:
        dual_norm="results/{scene}/dual_norm.nc",
    log:
        "results/logs/dual_norm/{scene}.log",
    benchmark:
        "results/benchmarks/dual_norm/{scene}.tsv"
    resources:
        **SOLVES,
    params:
        code=code("dual_norm"),
        scene=declared_scene,
    message:
        "{wildcards.scene}: the dual norm"
    script:
        "../scripts/dual_norm.py"


rule solve:
    input:
        scene_case_files,
        norm=lambda wildcards: f"results/{wildcards.scene}/dual_norm.nc" if has_norm(wildcards.scene) else [],
    output:
        mesh="results/{scene}/mesh.vtu",
        solutions="results/{scene}/solutions.nc",
        errors="results/{scene}/errors.nc",
        infsup="results/{scene}/infsup.nc",
        timings="results/{scene}/timings.nc",
    log:
        "results/logs/solve/{scene}.log",
    benchmark:
        "results/benchmarks/solve/{scene}.tsv"
    resources:
        **SOLVES,
    params:
        code=code("solve"),
        scene=declared_scene,
        stop=config["stop"],
    message:
        "{wildcards.scene}: all cases on all levels"
    script:
        "../scripts/solve.py"


rule rates:
    input:
        scene_case_files,
        errors="results/{scene}/errors.nc",
    output:
        rates="results/{scene}/rates.nc",
    log:
        "results/logs/rates/{scene}.log",
    benchmark:
        "results/benchmarks/rates/{scene}.tsv"
    resources:
        **TELLS,
    params:
        code=code("rates"),
        study=config["rates"],
        judged=lambda wildcards: declared_scene(wildcards)["judged"],
    message:
        "{wildcards.scene}: rates, judged"
    script:
        "../scripts/rates.py"


rule totals:
    input:
        scene_case_files,
        mesh="results/{scene}/mesh.vtu",
        solutions="results/{scene}/solutions.nc",
    output:
        totals="results/{scene}/totals.nc",
    log:
        "results/logs/totals/{scene}.log",
    benchmark:
        "results/benchmarks/totals/{scene}.tsv"
    resources:
        **SOLVES,
    params:
        code=code("totals"),
        scene=declared_scene,
        levels=config["totals"]["levels"],
        case_names=lambda wildcards: config["totals"]["scenes"][wildcards.scene],
        ratio=config["rates"]["judged_ratio"],
    message:
        "{wildcards.scene}: the guaranteed total errors"
    script:
        "../scripts/totals.py"


rule floors:
    input:
        scene_case_files,
        errors="results/{scene}/errors.nc",
    output:
        floors="results/{scene}/floors.nc",
    log:
        "results/logs/floors/{scene}.log",
    benchmark:
        "results/benchmarks/floors/{scene}.tsv"
    resources:
        **TELLS,
    params:
        code=code("floors"),
        ratio=config["rates"]["judged_ratio"],
    message:
        "{wildcards.scene}: the floors that h and H leave in H1"
    script:
        "../scripts/floors.py"


rule u_in_l2:
    input:
        scene_case_files,
        mesh="results/{scene}/mesh.vtu",
    output:
        u_in_l2="results/{scene}/u_in_l2.nc",
    log:
        "results/logs/u_in_l2/{scene}.log",
    benchmark:
        "results/benchmarks/u_in_l2/{scene}.tsv"
    resources:
        **SOLVES,
    params:
        code=code("u_in_l2"),
        scene=declared_scene,
        stop=config["stop"],
        ratio=config["rates"]["judged_ratio"],
    message:
        "{wildcards.scene}: the errors of u in L2"
    script:
        "../scripts/u_in_l2.py"
