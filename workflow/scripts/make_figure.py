"""A figure, drawn from its table, by its module."""

from importlib import import_module

from job import run

from unilateral.study.tables import save_csv


def main(module, arguments, csv, svg, **reads):
    figure = import_module(f"unilateral.study.{module}")
    save_csv(figure.table(**reads, **arguments), csv)
    figure.draw(csv, svg)


if __name__ == "__main__":
    run(main, snakemake)
