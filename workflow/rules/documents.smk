# Documents whose numbers come from the results, in marked blocks.


rule readme:
    input:
        code("fill_readme"),
        crossed="results/cost/algorithm.nc",
        cases="results/cost/case.nc",
        rates=expand("results/{scene}/rates.nc", scene=JUDGED),
        pairs="figures/infsup.csv",
        figures=COMMITTED,
    output:
        update("README.md"),
    params:
        scenes=JUDGED,
        judged_ratio=config["rates"]["judged_ratio"],
        infsup=config["infsup"],
        cost=config["cost"],
    message:
        "README.md: its tables"
    script:
        "../scripts/fill_readme.py"


rule filled_paper:
    input:
        code("fill_paper"),
        **{name: f"results/cost/{name}.nc" for name in ("algorithm", "case", "scene", "algebra", "precision")},
        claims="results/claims.json",
        rates=expand("results/{scene}/rates.nc", scene=JUDGED),
        pairs="figures/infsup.csv",
        floors="results/square/floors.nc",
        sharpness="results/sharpness/rates.nc",
        totals=expand("results/{scene}/totals.nc", scene=config["totals"]["scenes"]),
        extremes="results/extremes/extremes.nc",
    output:
        update("paper.md"),
    params:
        **{name: config[name] for name in ("cost", "extremes", "deep")},
        scenes=JUDGED,
        judged_ratio=config["rates"]["judged_ratio"],
        infsup=config["infsup"],
        norms=config["rates"]["norms"],
        bounded=list(config["totals"]["scenes"]),
    message:
        "paper.md: its tables"
    script:
        "../scripts/fill_paper.py"
