"""The jobs that targets need where nothing is made yet, as JSON.

Of each what its rule says: script, input, output, wildcards, params, log and benchmark, and the memory that
it asks for.

`python planned.py TARGET ...`, in a folder with a Snakefile. One process plans for all tests. Snakemake's
public interface runs or prints jobs and does not list them, so `_workflow.dag`, a private name, is read.
"""

import json
import sys
from pathlib import Path

from snakemake.api import DAGSettings, OutputSettings, ResourceSettings, SnakemakeApi
from snakemake.settings.enums import Quietness


def main(targets):
    with SnakemakeApi(OutputSettings(quiet={Quietness.ALL}, dryrun=True)) as api:
        workflow = api.workflow(resource_settings=ResourceSettings(cores=1), snakefile=Path("Snakefile"))
        workflow.dag(DAGSettings(targets=set(targets))).execute_workflow(executor="dryrun")
        print(json.dumps([describe_job(job) for job in workflow._workflow.dag.jobs]))


def describe_job(job):
    named = {name: files if isinstance(files, str) else list(files) for name, files in job.input.items()}
    params = dict(job.params.items())
    return {
        "rule": job.rule.name,
        "script": job.rule.script,
        "input": list(map(str, job.input)),
        "named": named,
        "output": list(map(str, job.output)),
        "params": params,
        "unnamed": [value for value in job.params if value not in params.values()],
        "wildcards": dict(job.wildcards_dict),
        "names": {"input": [*named], "output": [*dict(job.output.items())], "params": [*params]},
        "log": list(map(str, job.log)),
        "benchmark": job.benchmark and str(job.benchmark),
        "mem_mb": job.resources.get("mem_mb"),
    }


if __name__ == "__main__":
    main(sys.argv[1:])
