"""The paper as HTML and as PDF."""

from sentences import speak_plainly

from unilateral.study.text import typesetting

if __name__ == "__main__":
    speak_plainly()
    typesetting.typeset(
        snakemake.input.paper,
        snakemake.input.numbers,
        snakemake.input.page_template,
        snakemake.input.print_template,
        snakemake.output.html,
        snakemake.output.pdf,
    )
