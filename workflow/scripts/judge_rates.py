"""The rates of a scene, judged as the table of expected rates says."""

from unilateral import case, rates, tables


def main(errors, study, judged, name, path):
    table = tables.load(errors)
    judgements = rates.judge_all(table, study, {c: case.declared(c)[0]["asymptotic"] for c in table["case"].values})
    found = rates.collect(judgements)
    if not judged:
        found["verdict"][:] = "not judged"
    tables.save(found, path, name)
    print(rates.summary(found, rates.fraction(study["judged_ratio"])))


if __name__ == "__main__":
    main(
        snakemake.input.errors,
        snakemake.params.rates,
        snakemake.params.judged,
        snakemake.wildcards.scene,
        snakemake.output[0],
    )
