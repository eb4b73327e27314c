# Documents whose numbers come from the results, in marked blocks.


rule readme:
    input:
        library("documents", "tables", "rates"),
        rates=expand("results/{scene}/rates.nc", scene=JUDGED),
        pairs="figures/infsup.csv",
        figures=FIGURES,
    output:
        update("README.md"),
    params:
        scenes=JUDGED,
        judged_ratio=config["rates"]["judged_ratio"],
        infsup=config["infsup"],
    message:
        "README.md: its tables"
    script:
        "../scripts/fill_readme.py"


rule filled_paper:
    input:
        library("documents", "verdicts", "tables", "expression"),
        claims="results/claims.json",
        rates=expand("results/{scene}/rates.nc", scene=JUDGED),
        pairs="figures/infsup.csv",
        floors="results/square/floors.nc",
        sharpness="results/sharpness/rates.nc",
    output:
        update("paper.md"),
    params:
        scenes=JUDGED,
        judged_ratio=config["rates"]["judged_ratio"],
        infsup=config["infsup"],
        norms=config["rates"]["norms"],
    message:
        "paper.md: its tables"
    script:
        "../scripts/fill_paper.py"
