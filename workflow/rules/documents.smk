# Documents: people write them, numbers and tables are filled in between their marks.

DOCUMENTS = config["documents"]
COST_TABLES = ("algorithm", "case", "scene", "algebra", "precision")


wildcard_constraints:
    document="|".join(map(re.escape, DOCUMENTS)),


rule numbers:
    input:
        code("write_numbers"),
        **{name: f"results/cost/{name}.nc" for name in COST_TABLES},
        claims="results/claims.json",
        rates=expand("results/{scene}/rates.nc", scene=JUDGED),
        pairs="figures/infsup.csv",
        floors="results/square/floors.nc",
        sharpness="results/sharpness/rates.nc",
        totals=expand("results/{scene}/totals.nc", scene=config["totals"]["scenes"]),
        extremes="results/extremes/extremes.nc",
    output:
        numbers="results/numbers.json",
        blocks="results/blocks.json",
    log:
        "results/logs/numbers.log",
    params:
        study={
            **{name: config[name] for name in ("cost", "extremes", "infsup")},
            "judged": JUDGED,
            "bounded": list(config["totals"]["scenes"]),
            "judged_ratio": config["rates"]["judged_ratio"],
            "norms": config["rates"]["norms"],
            "figures": in_git(config),
        },
    message:
        "The numbers and tables of all documents"
    script:
        "../scripts/write_numbers.py"


rule document:
    input:
        code("fill_document"),
        numbers="results/numbers.json",
        blocks="results/blocks.json",
        claims="results/claims.json",
    output:
        document=update("{document}"),
    log:
        "results/logs/document/{document}.log",
    message:
        "{wildcards.document}: its numbers and tables"
    script:
        "../scripts/fill_document.py"
