# Each figure is drawn from a rounded table that is committed beside it.

FIGURES = [
    f"figures/{kind}_{scene}.{ending}"
    for scene in SCENES
    for kind in SCENES[scene]["figures"]
    for ending in ("csv", "svg")
]
FIGURES += [
    f"figures/{portrait}{part}" for portrait in PORTRAITS for part in ("_mesh.csv", "_boundary.csv", ".svg")
]
FIGURES += [
    f"figures/{name}.{ending}"
    for name in ("consistency", "extremes", "infsup", "multiplier", "sharpness", "verdict", "work_precision")
    for ending in ("csv", "svg")
]


wildcard_constraints:
    portrait="|".join(PORTRAITS),


rule rates_table:
    input:
        code("table_rates"),
        errors="results/{scene}/errors.nc",
        rates="results/{scene}/rates.nc",
    output:
        update("figures/rates_{scene}.csv"),
    message:
        "{wildcards.scene}: the table behind the figure of rates"
    script:
        "../scripts/table_rates.py"


rule grid_table:
    input:
        code("table_grid"),
        errors="results/{scene}/errors.nc",
    output:
        update("figures/grid_{scene}.csv"),
    params:
        cases=lambda wildcards: scene_of(wildcards)["grid_cases"],
    message:
        "{wildcards.scene}: the table behind the map over (h, H)"
    script:
        "../scripts/table_grid.py"


rule rates_figure:
    input:
        code("draw_rates"),
        table="figures/rates_{scene}.csv",
    output:
        update("figures/rates_{scene}.svg"),
    message:
        "{wildcards.scene}: the figure of rates"
    script:
        "../scripts/draw_rates.py"


rule grid_figure:
    input:
        code("draw_grid"),
        table="figures/grid_{scene}.csv",
    output:
        update("figures/grid_{scene}.svg"),
    message:
        "{wildcards.scene}: the map over (h, H)"
    script:
        "../scripts/draw_grid.py"


rule portrait_tables:
    input:
        code("table_portrait"),
        lambda wildcards: f"manufactured/{PORTRAITS[wildcards.portrait]['case']}.yaml",
    output:
        mesh=update("figures/{portrait}_mesh.csv"),
        boundary=update("figures/{portrait}_boundary.csv"),
    params:
        portrait=lambda wildcards: PORTRAITS[wildcards.portrait],
    message:
        "{wildcards.portrait}: the tables behind its picture"
    script:
        "../scripts/table_portrait.py"


rule portrait_figure:
    input:
        code("draw_portrait"),
        mesh="figures/{portrait}_mesh.csv",
        boundary="figures/{portrait}_boundary.csv",
    output:
        update("figures/{portrait}.svg"),
    message:
        "{wildcards.portrait}: its picture"
    script:
        "../scripts/draw_portrait.py"


rule infsup_table:
    input:
        code("table_infsup"),
        surveys=expand("results/{survey}/infsup.nc", survey=SURVEYS),
    output:
        update("figures/infsup.csv"),
    params:
        surveys=SURVEYS,
    message:
        "The table behind the figure of beta"
    script:
        "../scripts/table_infsup.py"


rule multiplier_table:
    input:
        code("table_multiplier"),
        survey=f"results/{config['multiplier']['survey']}/infsup.nc",
    output:
        update("figures/multiplier.csv"),
    params:
        h_over_H=config["multiplier"]["h_over_H"],
    message:
        "The table behind the figure of the worst multipliers"
    script:
        "../scripts/table_multiplier.py"


rule dual_table:
    input:
        code("table_dual"),
        errors="results/{scene}/errors.nc",
        norm="results/{scene}/dual_norm.nc",
    output:
        update("figures/dual_{scene}.csv"),
    params:
        scene=scene_of,
        h_over_H=config["rates"]["judged_ratio"],
    message:
        "{wildcards.scene}: the table behind the figure of the dual norm"
    script:
        "../scripts/table_dual.py"


rule infsup_figure:
    input:
        code("draw_infsup"),
        table="figures/infsup.csv",
    output:
        update("figures/infsup.svg"),
    message:
        "The figure of beta"
    script:
        "../scripts/draw_infsup.py"


rule multiplier_figure:
    input:
        code("draw_multiplier"),
        table="figures/multiplier.csv",
    output:
        update("figures/multiplier.svg"),
    message:
        "The figure of the worst multipliers"
    script:
        "../scripts/draw_multiplier.py"


rule dual_figure:
    input:
        code("draw_dual"),
        table="figures/dual_{scene}.csv",
    output:
        update("figures/dual_{scene}.svg"),
    message:
        "{wildcards.scene}: the figure of the dual norm"
    script:
        "../scripts/draw_dual.py"


rule verdict_table:
    input:
        code("table_verdict"),
        claims="results/claims.json",
    output:
        update("figures/verdict.csv"),
    message:
        "The table behind the figure of all verdicts"
    script:
        "../scripts/table_verdict.py"


rule verdict_figure:
    input:
        code("draw_verdict"),
        table="figures/verdict.csv",
    output:
        update("figures/verdict.svg"),
    message:
        "The figure of all verdicts"
    script:
        "../scripts/draw_verdict.py"


rule consistency_table:
    input:
        code("table_consistency"),
        [
            f"manufactured/{case}.yaml"
            for cases in ([CONSISTENCY["cells"]["case"]], *CONSISTENCY["totals"].values())
            for case in cases
        ],
        errors=expand("results/{scene}/errors.nc", scene=CONSISTENCY["totals"]),
    output:
        update("figures/consistency.csv"),
    params:
        drawn={
            **with_cases(CONSISTENCY["cells"]["scene"], [CONSISTENCY["cells"]["case"]]),
            "H": [CONSISTENCY["cells"]["H"]],
        },
        scenes=[with_cases(scene, cases) for scene, cases in CONSISTENCY["totals"].items()],
    message:
        "The table behind the figure of the consistency term"
    script:
        "../scripts/table_consistency.py"


rule consistency_figure:
    input:
        code("draw_consistency"),
        table="figures/consistency.csv",
    output:
        update("figures/consistency.svg"),
    message:
        "The figure of the consistency term"
    script:
        "../scripts/draw_consistency.py"


rule sharpness_table:
    input:
        code("table_sharpness"),
        rates="results/sharpness/rates.nc",
    output:
        update("figures/sharpness.csv"),
    message:
        "The table behind the figure of sharpness"
    script:
        "../scripts/table_sharpness.py"


rule sharpness_figure:
    input:
        code("draw_sharpness"),
        table="figures/sharpness.csv",
    output:
        update("figures/sharpness.svg"),
    message:
        "The figure of sharpness"
    script:
        "../scripts/draw_sharpness.py"
