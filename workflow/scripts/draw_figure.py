"""A figure, drawn by its module."""

from importlib import import_module

from job import run


def main(tables, module, look, figure):
    import_module(f"unilateral.study.figures.{module}").draw(*tables, figure, **look)


if __name__ == "__main__":
    run(main, snakemake)
