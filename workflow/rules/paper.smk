# The paper and its supplement, typeset; each is numbered with a look at the other, to which it refers.

PAPERS = ["paper", "supplement"]


wildcard_constraints:
    paper="|".join(PAPERS),


rule typeset:
    input:
        lambda wildcards: paper_figures(f"{wildcards.paper}.md"),
        "paper.bib",
        "workflow/paper/numeric.csl",
        expand("{paper}.md", paper=PAPERS),
        paper="{paper}.md",
        numbers="workflow/paper/numbers.lua",
        page_template="workflow/paper/paper.html",
        print_template="workflow/paper/paper.typ",
    output:
        html=report("results/paper/{paper}.html", category="Paper", labels={"paper": "{paper}, as a page"}),
        pdf=report("results/paper/{paper}.pdf", category="Paper", labels={"paper": "{paper}, in print"}),
    log:
        "results/logs/typeset/{paper}.log",
    benchmark:
        "results/benchmarks/typeset/{paper}.tsv"
    resources:
        **TELLS,
    params:
        code=code("typeset"),
    message:
        "The {wildcards.paper} as HTML and PDF"
    script:
        "../scripts/typeset.py"
