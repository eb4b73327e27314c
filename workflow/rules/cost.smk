# Accuracy against cost: the runs of a job's meshes -> tables -> the work-precision diagrams.

COST = config["cost"]
JOBS = range(len(COST["jobs"]))
RUNS = {name: COST[name] for name in ("base", "vary", "cross", "H", "stops", "max_steps", "costly_steps")}
AXES = [*COST["cross"], *([name] for name in COST["vary"] if name not in sum(COST["cross"], []))]


wildcard_constraints:
    job="[0-9]+",


rule cost_runs:
    input:
        code("experiments.cost.measure"),
        lambda wildcards: case_files(SCENES[job_of(wildcards)["scene"]]["cases"]),
        norm=lambda wildcards: f"results/{job_of(wildcards)['scene']}/dual_norm.nc",
    output:
        runs="results/cost/runs/{job}.nc",
        timings="results/cost/runs/{job}_timings.nc",
    log:
        "results/logs/cost_runs/{job}.log",
    resources:
        **SOLVES,
    params:
        job="experiments.cost.measure.measure_cost",
        scene=lambda wildcards: SCENES[job_of(wildcards)["scene"]],
        number="{job}",
        of_job=job_of,
        study=RUNS,
    message:
        "cost: the runs of job {wildcards.job}"
    script:
        "../scripts/job.py"


rule cost:
    input:
        code("experiments.cost.variants"),
        runs=expand("results/cost/runs/{job}.nc", job=JOBS),
        timed=expand("results/cost/runs/{job}_timings.nc", job=JOBS),
    output:
        cost="results/cost/cost.nc",
        timings="results/cost/timings.nc",
        factors=[f"results/cost/{fields[0]}.nc" for fields in AXES],
    log:
        "results/logs/cost.log",
    resources:
        **TELLS,
    params:
        job="experiments.cost.variants.collect_cost",
        study=RUNS,
        axes=AXES,
    message:
        "cost: all runs"
    script:
        "../scripts/job.py"
