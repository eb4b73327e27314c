# What the size of the cells alone does: cases with infinitely many transitions on one mesh.


rule cells:
    input:
        code("experiments.cells.measure"),
        case_files(config["cells"]["cases"]),
    output:
        errors="results/cells/errors.nc",
        alternating="results/cells/alternating.nc",
    log:
        "results/logs/cells.log",
    resources:
        **SOLVES,
    params:
        job="experiments.cells.measure.measure_cells",
        study=config["cells"],
        stop=config["stop"],
    message:
        "cells: infinitely many transitions, on cells of many sizes"
    script:
        "../scripts/job.py"
