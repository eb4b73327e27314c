# The figures: each is drawn from a table of its own, figures/NAME.csv, which is made from results.


rule draw_rates:
    input:
        errors="results/{scene}/errors.nc",
        rates="results/{scene}/rates.nc",
    output:
        **figure("rates_{scene}", "rates"),
    log:
        "results/logs/draw_rates/{scene}.log",
    benchmark:
        "results/benchmarks/draw_rates/{scene}.tsv"
    resources:
        **TELLS,
    params:
        code=code("draw_rates"),
    message:
        "The figure figures/rates_{wildcards.scene}.svg and its table"
    script:
        "../scripts/draw_rates.py"


rule draw_grid_square:
    input:
        errors="results/square/errors.nc",
    output:
        **figure("grid_square"),
    log:
        "results/logs/draw_grid_square.log",
    benchmark:
        "results/benchmarks/draw_grid_square.tsv"
    resources:
        **TELLS,
    params:
        cases=SHOWN["grid_square"]["cases"],
        code=code("draw_grid_square"),
    message:
        "The figure figures/grid_square.svg and its table"
    script:
        "../scripts/draw_grid_square.py"


rule draw_dual_square:
    input:
        errors="results/square/errors.nc",
        norm="results/square/dual_norm.nc",
    output:
        **figure("dual_square"),
    log:
        "results/logs/draw_dual_square.log",
    benchmark:
        "results/benchmarks/draw_dual_square.tsv"
    resources:
        **TELLS,
    params:
        scene=SCENES["square"],
        h_over_H=config["rates"]["judged_ratio"],
        code=code("draw_dual_square"),
    message:
        "The figure figures/dual_square.svg and its table"
    script:
        "../scripts/draw_dual_square.py"


rule draw_solution:
    output:
        **figure("solution"),
    log:
        "results/logs/draw_solution.log",
    benchmark:
        "results/benchmarks/draw_solution.tsv"
    resources:
        **TELLS,
    params:
        polygon=SHOWN["solution"]["polygon"],
        f=SHOWN["solution"]["f"],
        h=SHOWN["solution"]["h"],
        H=SHOWN["solution"]["H"],
        reference=SHOWN["solution"]["reference"],
        code=code("draw_solution"),
    message:
        "The figure figures/solution.svg and its table"
    script:
        "../scripts/draw_solution.py"


rule draw_consistency:
    input:
        case_files([SHOWN["consistency"]["case"], *SHOWN["consistency"]["cases"]]),
        errors=["results/square/errors.nc", "results/irregular/errors.nc"],
    output:
        **figure("consistency"),
    log:
        "results/logs/draw_consistency.log",
    benchmark:
        "results/benchmarks/draw_consistency.tsv"
    resources:
        **TELLS,
    params:
        scenes=[SCENES["square"], SCENES["irregular"]],
        case=SHOWN["consistency"]["case"],
        H=SHOWN["consistency"]["H"],
        cases=SHOWN["consistency"]["cases"],
        code=code("draw_consistency"),
    message:
        "The figure figures/consistency.svg and its table"
    script:
        "../scripts/draw_consistency.py"


rule draw_sharpness:
    input:
        rates="results/sharpness/rates.nc",
        fixed="results/sharpness/fixed_rates.nc",
    output:
        **figure("sharpness"),
    log:
        "results/logs/draw_sharpness.log",
    benchmark:
        "results/benchmarks/draw_sharpness.tsv"
    resources:
        **TELLS,
    params:
        code=code("draw_sharpness"),
    message:
        "The figure figures/sharpness.svg and its table"
    script:
        "../scripts/draw_sharpness.py"


rule draw_infsup:
    input:
        surveys=rules.surveys.output.tables,
    output:
        **figure("infsup"),
    log:
        "results/logs/draw_infsup.log",
    benchmark:
        "results/benchmarks/draw_infsup.tsv"
    resources:
        **TELLS,
    params:
        families=SURVEYS,
        code=code("draw_infsup"),
    message:
        "The figure figures/infsup.svg and its table"
    script:
        "../scripts/draw_infsup.py"


rule draw_adaptive:
    input:
        errors="results/adaptive/errors.nc",
        infsup="results/adaptive/infsup.nc",
    output:
        **figure("adaptive"),
    log:
        "results/logs/draw_adaptive.log",
    benchmark:
        "results/benchmarks/draw_adaptive.tsv"
    resources:
        **TELLS,
    params:
        code=code("draw_adaptive"),
    message:
        "The figure figures/adaptive.svg and its table"
    script:
        "../scripts/draw_adaptive.py"


rule draw_multiplier:
    input:
        survey="results/betasquare/infsup.nc",
    output:
        **figure("multiplier"),
    log:
        "results/logs/draw_multiplier.log",
    benchmark:
        "results/benchmarks/draw_multiplier.tsv"
    resources:
        **TELLS,
    params:
        h_over_H=SHOWN["multiplier"]["h_over_H"],
        code=code("draw_multiplier"),
    message:
        "The figure figures/multiplier.svg and its table"
    script:
        "../scripts/draw_multiplier.py"


rule draw_multipliers:
    input:
        errors="results/multipliers/errors.nc",
    output:
        **figure("multipliers"),
    log:
        "results/logs/draw_multipliers.log",
    benchmark:
        "results/benchmarks/draw_multipliers.tsv"
    resources:
        **TELLS,
    params:
        code=code("draw_multipliers"),
    message:
        "The figure figures/multipliers.svg and its table"
    script:
        "../scripts/draw_multipliers.py"


rule draw_extremes:
    input:
        extremes="results/extremes/extremes.nc",
    output:
        **figure("extremes"),
    log:
        "results/logs/draw_extremes.log",
    benchmark:
        "results/benchmarks/draw_extremes.tsv"
    resources:
        **TELLS,
    params:
        code=code("draw_extremes"),
    message:
        "The figure figures/extremes.svg and its table"
    script:
        "../scripts/draw_extremes.py"


rule draw_reaction:
    input:
        reaction="results/extremes/reaction.nc",
    output:
        **figure("reaction"),
    log:
        "results/logs/draw_reaction.log",
    benchmark:
        "results/benchmarks/draw_reaction.tsv"
    resources:
        **TELLS,
    params:
        code=code("draw_reaction"),
    message:
        "The figure figures/reaction.svg and its table"
    script:
        "../scripts/draw_reaction.py"


rule draw_verdict:
    input:
        claims="results/claims.json",
    output:
        **figure("verdict"),
    log:
        "results/logs/draw_verdict.log",
    benchmark:
        "results/benchmarks/draw_verdict.tsv"
    resources:
        **TELLS,
    params:
        code=code("draw_verdict"),
    message:
        "The figure figures/verdict.svg and its table"
    script:
        "../scripts/draw_verdict.py"


rule draw_work_precision:
    input:
        crossed="results/cost/algorithm.nc",
        cases="results/cost/case.nc",
        algebra="results/cost/algebra.nc",
    output:
        **figure("work_precision"),
    log:
        "results/logs/draw_work_precision.log",
    benchmark:
        "results/benchmarks/draw_work_precision.tsv"
    resources:
        **TELLS,
    params:
        base=COST["base"],
        coarsest=COST["fitted_from"],
        code=code("draw_work_precision"),
    message:
        "The figure figures/work_precision.svg and its table"
    script:
        "../scripts/draw_work_precision.py"


rule draw_benchmarks:
    input:
        results="benchmarks/results.nc",
    output:
        **figure("benchmarks"),
    log:
        "results/logs/draw_benchmarks.log",
    benchmark:
        "results/benchmarks/draw_benchmarks.tsv"
    resources:
        **TELLS,
    params:
        code=code("draw_benchmarks"),
    message:
        "The figure figures/benchmarks.svg and its table"
    script:
        "../scripts/draw_benchmarks.py"


# The files of each rule: those of `draw_rates` are of each of its scenes.
DRAWN = {
    "draw_rates": expand(rules.draw_rates.output, scene=SHOWN["rates"]["scenes"]),
    **{f"draw_{name}": getattr(rules, f"draw_{name}").output for name in SHOWN if name != "rates"},
}
FIGURES = [file for files in DRAWN.values() for file in files]
