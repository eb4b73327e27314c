# Documents whose numbers come from the results, in marked blocks.


rule readme:
    input:
        library("documents", "tables", "rates"),
        rates=expand("results/{scene}/rates.nc", scene=JUDGED),
        figures=FIGURES,
    output:
        update("README.md"),
    params:
        scenes=JUDGED,
        judged_ratio=config["rates"]["judged_ratio"],
    message:
        "README.md: the table of rates"
    script:
        "../scripts/fill_readme.py"
