"""Errors and bounds on uniform meshes and on adapted ones, their rates, and beta on the adapted ones."""

from itertools import chain

from job import run

from unilateral.formulas.formula import real
from unilateral.problems import problem_file
from unilateral.solvers.stop import Stop
from unilateral.study import tables
from unilateral.study.experiments.adaptive import measure as adaptive
from unilateral.study.experiments.adaptive.rates import rates_over
from unilateral.study.scenes import cases


def main(examples, study, stop, errors, infsup, timings, rates):
    problems = [*chain.from_iterable(map(cases, study["scenes"])), *map(problem_file.load, examples)]
    h, limits, found = real(study["h"], "adaptive.h"), adaptive.MostUnknowns(**study["most"]), []
    for problem in problems:
        found.append(adaptive.measure(problem, h, limits, Stop(**stop)))
        print(f"{problem.name} measured")
    names, given = [problem.name for problem in problems], {"adaptive": study, "stop": stop}
    for parts, path in zip(zip(*found, strict=True), (errors, infsup, timings), strict=True):
        tables.save(adaptive.together(parts, "case", names), path, "adaptive", given)
    tables.save(rates_over(tables.load(errors), study["factor"]), rates, "adaptive", given)


if __name__ == "__main__":
    run(main, snakemake)
