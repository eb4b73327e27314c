"""The manifest of all that the study made; its rule names the files by the rules that made them."""

from job import run

from unilateral.study.manifest import write


def main(study, manifest, sums, **made):
    write(made, study, manifest, sums)


if __name__ == "__main__":
    run(main, snakemake)
