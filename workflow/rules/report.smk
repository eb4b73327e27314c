# What `snakemake --report` shows beside the figures and the paper, as pages.


report: "../../results/report/study.rst"


PAGES = {
    "claims": "Every claim, judged",
    "rates": "Rates, observed and expected",
    "provenance": "Versions, parameters",
}


rule pages:
    input:
        numbers="results/numbers.json",
        blocks="results/blocks.json",
        claims="results/claims.json",
        manifest="results/manifest.json",
        parameters=PARAMETERS,
        texts=expand("workflow/report/{page}.md", page=PAGES),
        front_text="workflow/report/study.md",
        filter="workflow/paper/numbers.lua",
        template="workflow/paper/paper.html",
    output:
        pages=[
            report(f"results/report/{page}.html", category="Tables", labels={"table": shows})
            for page, shows in PAGES.items()
        ],
        front_page="results/report/study.rst",
    log:
        "results/logs/pages.log",
    benchmark:
        "results/benchmarks/pages.tsv"
    resources:
        **TELLS,
    params:
        code=code("pages"),
    message:
        "The pages of the report"
    script:
        "../scripts/pages.py"


rule curves:
    input:
        case_files(sorted({case for scene in JUDGED for case in SCENES[scene]["cases"]})),
        errors=expand("results/{scene}/errors.nc", scene=JUDGED),
        rates=expand("results/{scene}/rates.nc", scene=JUDGED),
        totals=expand("results/{scene}/totals.nc", scene=TOTALS),
        template="workflow/report/curves.html",
    output:
        page=report(
            "results/report/curves.html",
            category="Tables",
            labels={"table": "Errors and rates, to choose from"},
        ),
    log:
        "results/logs/curves.log",
    benchmark:
        "results/benchmarks/curves.tsv"
    resources:
        **TELLS,
    params:
        code=code("curves"),
    message:
        "The page of the report on which a case, a norm and h/H are chosen"
    script:
        "../scripts/curves.py"
