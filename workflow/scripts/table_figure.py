"""A table behind a figure, made by the figure's module."""

from importlib import import_module

from job import run

from unilateral.study.tables import save_csv


def main(module, part, arguments, csv, **reads):
    made = import_module(f"unilateral.study.figures.{module}").table(**reads, **arguments)
    save_csv(made[part] if part else made, csv)


if __name__ == "__main__":
    run(main, snakemake)
