# Every file of the study by the rule that makes it -> what was made, from what and with what.

# Snakemake makes a file anew that is missing only if it is a target, or if what follows from it is made anew.
MADE = {
    **files_by_rule(JUDGED),
    "floors": expand(rules.floors.output, scene=config["floors"]),
    "totals": expand(rules.totals.output, scene=TOTALS),
    "surveys": rules.surveys.output,
    "cost": rules.cost.output,
    "adaptive": rules.adaptive.output,
    "algorithm": rules.algorithm.output,
    "cells": rules.cells.output,
    "certify": rules.certify.output,
    "extremes": rules.extremes.output,
    "graded": rules.graded.output,
    "sharpness": rules.sharpness.output,
    "claims": rules.claims.output,
    "document_numbers": rules.document_numbers.output,
    **DRAWN,
    "documents": DOCUMENTS,
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
    resources:
        **TELLS,
    params:
        code=code("manifest"),
        study=config,
    message:
        "The manifest of all results"
    script:
        "../scripts/manifest.py"
