# Documents: people write them, numbers and tables are filled in between their marks.

DOCUMENTS = config["documents"]


rule document_numbers:
    input:
        files=[
            "results/claims.json",
            "benchmarks/installations.json",
            "benchmarks/whole.json",
            "results/adaptive/errors.nc",
            "results/adaptive/infsup.nc",
            "results/adaptive/rates.nc",
            "benchmarks/results.nc",
            "benchmarks/scores.csv",
            "benchmarks/commands.json",
            "benchmarks/trust.json",
            "benchmarks/precision.json",
            "results/cells/errors.nc",
            "results/cells/alternating.nc",
            "results/certain/contact.nc",
            "results/certify/solutions.nc",
            "results/cost/algorithm.nc",
            "results/cost/case.nc",
            "results/cost/scene.nc",
            "results/cost/algebra.nc",
            "results/cost/precision.nc",
            "results/extremes/extremes.nc",
            "results/extremes/reaction.nc",
            "results/graded/errors.nc",
            "results/graded/adapted.nc",
            "results/multipliers/errors.nc",
            *expand("results/{scene}/rates.nc", scene=JUDGED),
            *expand("results/{scene}/totals.nc", scene=TOTALS),
            "results/square/floors.nc",
            "results/square/errors.nc",
            *expand("results/{scene}/u_in_l2.nc", scene=config["u_in_l2"]),
            "results/sharpness/rates.nc",
            "figures/infsup.csv",
        ],
    output:
        numbers="results/numbers.json",
        blocks="results/blocks.json",
    log:
        "results/logs/document_numbers.log",
    benchmark:
        "results/benchmarks/document_numbers.tsv"
    resources:
        **TELLS,
    params:
        study=config,
        code=code("document_numbers"),
    message:
        "The numbers and tables of all documents"
    script:
        "../scripts/document_numbers.py"


rule documents:
    input:
        numbers="results/numbers.json",
        blocks="results/blocks.json",
        claims="results/claims.json",
    output:
        documents=update(DOCUMENTS),
    log:
        "results/logs/documents.log",
    benchmark:
        "results/benchmarks/documents.tsv"
    resources:
        **TELLS,
    params:
        [marks.digest_prose(document) for document in DOCUMENTS],  # by which Snakemake sees that one was edited
        code=code("documents"),
    message:
        "The documents' numbers and tables"
    script:
        "../scripts/documents.py"
