"""The table behind the figure of all verdicts."""

from sentences import speak_plainly

from unilateral.study import tables
from unilateral.study.text import verdicts


def main(claims, path):
    tables.save_csv(verdicts.verdict_frame(verdicts.read(claims)), path)


if __name__ == "__main__":
    speak_plainly()
    main(snakemake.input.claims, snakemake.output[0])
