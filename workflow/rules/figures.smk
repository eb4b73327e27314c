# A figure is a module with its table and its drawing, and an entry in workflow/config/figures.yaml.

DRAWN = drawings(config)
DRAWN_FROM = {table: drawing for drawing in DRAWN.values() for table in drawing.parts}
FIGURES = [f"{path}.svg" for path in DRAWN] + [f"{path}.csv" for path in DRAWN_FROM]
COMMITTED = [path for path in FIGURES if path.startswith("figures/")]


wildcard_constraints:
    figure="|".join(DRAWN),
    table="|".join(DRAWN_FROM),


rule figure_table:
    input:
        lambda wildcards: code("table_figure", f"study.figures.{DRAWN_FROM[wildcards.table].module}"),
        lambda wildcards: case_files(DRAWN_FROM[wildcards.table].cases),
        unpack(lambda wildcards: DRAWN_FROM[wildcards.table].reads),
    output:
        csv=update("{table}.csv"),
    log:
        "results/logs/figure_table/{table}.log",
    params:
        module=lambda wildcards: DRAWN_FROM[wildcards.table].module,
        part=lambda wildcards: DRAWN_FROM[wildcards.table].parts[wildcards.table],
        arguments=lambda wildcards: DRAWN_FROM[wildcards.table].arguments,
    message:
        "The table {wildcards.table}.csv"
    script:
        "../scripts/table_figure.py"


rule figure:
    input:
        lambda wildcards: code("draw_figure", f"study.figures.{DRAWN[wildcards.figure].module}"),
        tables=lambda wildcards: [f"{table}.csv" for table in DRAWN[wildcards.figure].parts],
    output:
        figure=update("{figure}.svg"),
    log:
        "results/logs/figure/{figure}.log",
    params:
        module=lambda wildcards: DRAWN[wildcards.figure].module,
        look=lambda wildcards: DRAWN[wildcards.figure].look,
    message:
        "The figure {wildcards.figure}.svg"
    script:
        "../scripts/draw_figure.py"
