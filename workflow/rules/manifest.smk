# Every file of the study by the rule that makes it -> what was made, from what and with what.

# Snakemake makes a file anew that is missing only if it is a target, or if what follows from it is made anew.
MADE = {
    **files_by_rule(JUDGED),
    "floors": expand(rules.floors.output, scene=config["floors"]),
    "totals": expand(rules.totals.output, scene=config["totals"]["scenes"]),
    "surveys": rules.surveys.output,
    **{rule.name: rule.output for rule in workflow.rules if rule.name in registry.experiments()},
    "claims": rules.claims.output,
    "numbers": rules.numbers.output,
    "figure": FIGURES,
    "documents": DOCUMENTS,
    "typeset": expand(rules.typeset.output, paper=PAPERS),
}


rule manifest:
    input:
        code("manifest"),
        **MADE,
    output:
        manifest="results/manifest.json",
        sums="results/SHA256SUMS",
    log:
        "results/logs/manifest.log",
    resources:
        **TELLS,
    params:
        job="manifest.write_manifest",
        study=config,
    message:
        "The manifest of all results"
    script:
        "../scripts/job.py"
