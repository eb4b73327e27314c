# The paper, typeset.


def shown(wildcards):
    """The figures that the paper shows."""
    text = Path("paper.md").read_text(encoding="utf-8")
    return sorted(set(re.findall(r"\]\((figures/\w+\.svg)\)", text)))


rule paper:
    input:
        code("typeset_paper"),
        shown,
        "paper.bib",
        paper="paper.md",
        numbers="workflow/paper/numbers.lua",
        page_template="workflow/paper/paper.html",
        print_template="workflow/paper/paper.typ",
    output:
        html="results/paper/paper.html",
        pdf="results/paper/paper.pdf",
    message:
        "The paper as HTML and PDF"
    script:
        "../scripts/typeset_paper.py"
