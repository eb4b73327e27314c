# Accuracy against cost: runs along axes that leave a base -> a table for each axis.

COST = config["cost"]
# What only claims, documents and figures read makes no table.
MEASURED = {name: value for name, value in COST.items() if name not in ("fitted_from", "targets")}


rule cost:
    input:
        [case_files(SCENES[scene]["cases"]) for scene in COST["h"]],
        norms=expand("results/{scene}/dual_norm.nc", scene=COST["h"]),
    output:
        axes=expand("results/cost/{axis}.nc", axis=COST["axes"]),
    log:
        "results/logs/cost.log",
    benchmark:
        "results/benchmarks/cost.tsv"
    priority: 1
    resources:
        **SOLVES,
    params:
        scene={scene: SCENES[scene] for scene in COST["h"]},
        study=MEASURED,
        code=code("cost"),
    message:
        "cost: all runs"
    script:
        "../scripts/cost.py"
