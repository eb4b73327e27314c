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


wildcard_constraints:
    portrait="|".join(PORTRAITS),


rule rates_table:
    input:
        library("figure_data", "tables"),
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
        library("figure_data", "tables"),
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
        library("plots"),
        table="figures/rates_{scene}.csv",
    output:
        update("figures/rates_{scene}.svg"),
    message:
        "{wildcards.scene}: the figure of rates"
    script:
        "../scripts/draw_rates.py"


rule grid_figure:
    input:
        library("plots"),
        table="figures/grid_{scene}.csv",
    output:
        update("figures/grid_{scene}.svg"),
    message:
        "{wildcards.scene}: the map over (h, H)"
    script:
        "../scripts/draw_grid.py"


rule portrait_tables:
    input:
        library("figure_data", "tables", "mesh", "certificate"),
        "workflow/scripts/scenes.py",
        CASE_SCHEMA,
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
        library("plots"),
        mesh="figures/{portrait}_mesh.csv",
        boundary="figures/{portrait}_boundary.csv",
    output:
        update("figures/{portrait}.svg"),
    message:
        "{wildcards.portrait}: its picture"
    script:
        "../scripts/draw_portrait.py"
