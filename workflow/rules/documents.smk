# Documents: people write them, numbers and tables are filled in between their marks.

DOCUMENTS = config["documents"]
COST_TABLES = ("algorithm", "case", "scene", "algebra", "precision")


rule numbers:
    input:
        code("write_numbers"),
        **{name: f"results/cost/{name}.nc" for name in COST_TABLES},
        claims="results/claims.json",
        rates=expand("results/{scene}/rates.nc", scene=JUDGED),
        pairs="figures/infsup.csv",
        floors="results/square/floors.nc",
        sharpness="results/sharpness/rates.nc",
        cells="results/cells/errors.nc",
        alternating="results/cells/alternating.nc",
        adapted="results/adaptive/errors.nc",
        adapted_rates="results/adaptive/rates.nc",
        adapted_beta="results/adaptive/infsup.nc",
        totals=expand("results/{scene}/totals.nc", scene=config["totals"]["scenes"]),
        extremes="results/extremes/extremes.nc",
        benchmarks="benchmarks/results.nc",
        scores="benchmarks/scores.csv",
        commands="benchmarks/commands.json",
        whole="benchmarks/whole.json",
    output:
        numbers="results/numbers.json",
        blocks="results/blocks.json",
    log:
        "results/logs/numbers.log",
    resources:
        **TELLS,
    params:
        study={
            **{name: config[name] for name in ("adaptive", "cost", "extremes", "infsup")},
            "judged": JUDGED,
            "bounded": list(config["totals"]["scenes"]),
            "judged_ratio": config["rates"]["judged_ratio"],
            "norms": config["rates"]["norms"],
            "figures": shown(config),
        },
    message:
        "The numbers and tables of all documents"
    script:
        "../scripts/write_numbers.py"


rule documents:
    input:
        code("fill_documents"),
        numbers="results/numbers.json",
        blocks="results/blocks.json",
        claims="results/claims.json",
    output:
        documents=update(DOCUMENTS),
    log:
        "results/logs/documents.log",
    resources:
        **TELLS,
    message:
        "The documents' numbers and tables"
    script:
        "../scripts/fill_documents.py"
