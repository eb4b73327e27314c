# Every file of the study by the rule that makes it -> what was made, from what and with what.

# Snakemake makes a file anew that is missing only if it is a target, or if what follows from it is made anew.
MADE = {
    **files_by_rule(JUDGED),
    "floors": expand(rules.floors.output, scene=config["floors"]),
    "totals": expand(rules.totals.output, scene=TOTALS),
    "u_in_l2": expand(rules.u_in_l2.output, scene=config["u_in_l2"]),
    # The rule of an experiment has the name of its fields in the configuration.
    **{rule.name: rule.output for rule in workflow.rules if rule.name in config and not rule.has_wildcards()},
    "claims": rules.claims.output,
    "document_numbers": rules.document_numbers.output,
    **DRAWN,
    "typeset": expand(rules.typeset.output, paper=PAPERS),
}


rule manifest:
    input:
        **MADE,
    output:
        manifest="results/manifest.json",
        sums="results/SHA256SUMS",
    log:
        "results/logs/manifest.log",
    benchmark:
        "results/benchmarks/manifest.tsv"
    resources:
        **TELLS,
    params:
        code=code("manifest"),
        study=config,
    message:
        "The manifest of all results"
    script:
        "../scripts/manifest.py"
