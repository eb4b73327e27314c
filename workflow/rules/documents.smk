# Documents: people write them, numbers and tables are filled in between their marks.

DOCUMENTS = config["documents"]


rule numbers:
    input:
        code("documents.numbers", *(f"{package}.numbers" for package in registry.having("numbers"))),
        numbers.files(config),
    output:
        numbers="results/numbers.json",
        blocks="results/blocks.json",
    log:
        "results/logs/numbers.log",
    resources:
        **TELLS,
    params:
        job="documents.numbers.write_numbers",
        study=config,
    message:
        "The numbers and tables of all documents"
    script:
        "../scripts/job.py"


rule documents:
    input:
        code("documents.marks"),
        numbers="results/numbers.json",
        blocks="results/blocks.json",
        claims="results/claims.json",
    output:
        documents=update(DOCUMENTS),
    log:
        "results/logs/documents.log",
    resources:
        **TELLS,
    params:
        [marks.written(document) for document in DOCUMENTS],  # by which Snakemake sees that one was edited
        job="documents.marks.fill_documents",
    message:
        "The documents' numbers and tables"
    script:
        "../scripts/job.py"
