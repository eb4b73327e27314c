"""The table behind the figure of beta."""

from sentences import speak_plainly

from unilateral.study import tables
from unilateral.study.figures import infsup_data


def main(paths, surveys, path):
    found = {
        name: (survey["label"], survey["kind"], tables.load(table))
        for (name, survey), table in zip(surveys.items(), paths, strict=True)
    }
    tables.save_csv(infsup_data.infsup_frame(found), path)


if __name__ == "__main__":
    speak_plainly()
    main(snakemake.input.surveys, snakemake.params.surveys, snakemake.output[0])
