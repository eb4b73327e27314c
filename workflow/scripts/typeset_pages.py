"""The report's pages: texts with marks, filled in and typeset."""

from job import run

from unilateral.study.documents import marks, provenance, verdicts
from unilateral.study.documents.typesetting import page_of
from unilateral.study.ledger import records
from unilateral.system.files import replacing


def main(numbers, blocks, claims, manifest, parameters, texts, filter, template, pages):
    known = records.read(blocks) | provenance.blocks(records.read(manifest), parameters)
    holding = verdicts.holding(records.read(claims))
    for text, page in zip(texts, pages, strict=True):
        told = marks.filled(text, records.read(numbers), known, holding)
        with replacing(page) as temporary:
            temporary.write_text(page_of(told, text, filter, template), encoding="utf-8")


if __name__ == "__main__":
    run(main, snakemake)
