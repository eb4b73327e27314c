"""A figure, drawn by its module."""

from importlib import import_module

from sentences import speak_plainly


def main(module, tables, look, path):
    import_module(f"unilateral.study.figures.{module}").draw(*tables, path, **look)


if __name__ == "__main__":
    speak_plainly()
    main(snakemake.params.module, snakemake.input.tables, snakemake.params.look, snakemake.output[0])
