# The paper, typeset.


rule paper:
    input:
        code("typeset_paper"),
        lambda wildcards: pictures("paper.md"),
        "paper.bib",
        paper="paper.md",
        numbers="workflow/paper/numbers.lua",
        page_template="workflow/paper/paper.html",
        print_template="workflow/paper/paper.typ",
    output:
        html=report("results/paper/paper.html", category="Paper", labels={"paper": "as a page"}),
        pdf=report("results/paper/paper.pdf", category="Paper", labels={"paper": "in print"}),
    log:
        "results/logs/paper.log",
    resources:
        **asked("paper"),
    message:
        "The paper as HTML and PDF"
    script:
        "../scripts/typeset_paper.py"
