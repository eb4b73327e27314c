"""The tables of the study of cost: all runs, those along each factor, and seconds."""

from sentences import speak_plainly

from unilateral.study import tables
from unilateral.study.judge import cost as trade
from unilateral.study.runs.cost import measure as cost
from unilateral.study.runs.cost import variants


def main(parts, timings, study, axes, results, timings_path, factors):
    planned = variants.plan(study)
    table = cost.along_runs([tables.load(path) for path in parts], planned)
    tables.save(table, results, "cost")
    tables.save(cost.along_runs([tables.load(path) for path in timings], planned), timings_path, "cost")
    for fields, path in zip(axes, factors, strict=True):
        tables.save(trade.along(table, planned[0], fields), path, "cost")


if __name__ == "__main__":
    speak_plainly()
    main(
        snakemake.input.parts,
        snakemake.input.timings,
        snakemake.params.study,
        snakemake.params.axes,
        snakemake.output.results,
        snakemake.output.timings,
        snakemake.output.factors,
    )
