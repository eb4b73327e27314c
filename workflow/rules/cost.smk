# Accuracy against cost: the runs of a job's meshes -> tables -> the work-precision diagrams.

COST = config["cost"]
RUNS = {name: COST[name] for name in ("base", "vary", "cross", "H", "stops", "max_steps", "costly_steps")}
AXES = [*COST["cross"], *([name] for name in COST["vary"] if name not in sum(COST["cross"], []))]


wildcard_constraints:
    job="[0-9]+",


def job_of(wildcards):
    return COST["jobs"][int(wildcards.job)]


rule cost_runs:
    input:
        code("measure_cost"),
        lambda wildcards: [
            f"manufactured/{case}.yaml" for case in SCENES[job_of(wildcards)["scene"]]["cases"]
        ],
        norm=lambda wildcards: f"results/{job_of(wildcards)['scene']}/dual_norm.nc",
    output:
        results="results/cost/runs/{job}.nc",
        timings="results/cost/runs/{job}_timings.nc",
    params:
        scene=lambda wildcards: SCENES[job_of(wildcards)["scene"]],
        study=RUNS,
        job=job_of,
    message:
        "cost: the runs of job {wildcards.job}"
    script:
        "../scripts/measure_cost.py"


rule cost:
    input:
        code("collect_cost"),
        parts=expand("results/cost/runs/{job}.nc", job=range(len(COST["jobs"]))),
        timings=expand("results/cost/runs/{job}_timings.nc", job=range(len(COST["jobs"]))),
    output:
        results="results/cost/cost.nc",
        timings="results/cost/timings.nc",
        factors=[f"results/cost/{fields[0]}.nc" for fields in AXES],
    params:
        study=RUNS,
        axes=AXES,
    message:
        "cost: all runs"
    script:
        "../scripts/collect_cost.py"
