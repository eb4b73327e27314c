"""A table behind a figure, made by the figure's module."""

from importlib import import_module

from sentences import speak_plainly

from unilateral.study import tables


def main(module, reads, arguments, part, path):
    made = import_module(f"unilateral.study.figures.{module}").table(**reads, **arguments)
    tables.save_csv(made[part] if part else made, path)


if __name__ == "__main__":
    speak_plainly()
    main(
        snakemake.params.module,
        dict(snakemake.input.items()),
        snakemake.params.arguments,
        snakemake.params.part,
        snakemake.output[0],
    )
