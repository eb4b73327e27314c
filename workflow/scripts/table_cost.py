"""The table behind the work-precision diagrams, in operations or, where times are given, in seconds."""

from sentences import speak_plainly

from unilateral.formulas.formula import real
from unilateral.study import tables
from unilateral.study.figures import work_data
from unilateral.study.runs.cost import variants


def main(crossed, cases, algebra, timings, study, path):
    crossed, cases, algebra = (tables.load(each) for each in (crossed, cases, algebra))
    if timings:
        base = variants.plan(study)[0]
        crossed, algebra = work_data.in_seconds(
            crossed, algebra, tables.load(timings), base, study["cross"][0]
        )
    H_over_h, coarsest = (
        real(study["base"]["H_over_h"], "H_over_h"),
        real(study["fitted_from"], "fitted_from"),
    )
    tables.save_csv(work_data.work_frame(crossed, cases, algebra, H_over_h, coarsest), path)


if __name__ == "__main__":
    speak_plainly()
    main(
        snakemake.input.crossed,
        snakemake.input.cases,
        snakemake.input.algebra,
        snakemake.input.get("timings"),
        snakemake.params.study,
        snakemake.output[0],
    )
