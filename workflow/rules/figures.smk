# A figure is a module with its table and its drawing, and an entry in workflow/config/figures.yaml.

DRAWN = drawings(config)
FIGURES = [f"figures/{name}.{kind}" for name in DRAWN for kind in ("csv", "svg")]


wildcard_constraints:
    figure="|".join(DRAWN),


rule figure:
    input:
        lambda wildcards: code("figure_entries", DRAWN[wildcards.figure].module),
        lambda wildcards: case_files(DRAWN[wildcards.figure].cases),
        unpack(lambda wildcards: DRAWN[wildcards.figure].reads),
    output:
        csv=update("figures/{figure}.csv"),
        svg=report(
            update("figures/{figure}.svg"),
            category="Figures",
            caption="../report/figure.rst",
            labels=lambda wildcards: {
                "figure": wildcards.figure,
                "shows": DRAWN[wildcards.figure].shows,
            },
        ),
    log:
        "results/logs/figure/{figure}.log",
    resources:
        **TELLS,
    params:
        job="figure_entries.make_figure",
        module=lambda wildcards: DRAWN[wildcards.figure].module,
        arguments=lambda wildcards: DRAWN[wildcards.figure].arguments,
    message:
        "The figure figures/{wildcards.figure}.svg and its table"
    script:
        "../scripts/job.py"
