# `make` runs the whole study, `make help` lists the targets.
.DEFAULT_GOAL := study
.NOTPARALLEL:
odd := $(shell pwd -P | LC_ALL=C tr -d 'A-Za-z0-9_./+,@%=~\200-\377\n-')
ifneq ($(odd),)
$(error Snakemake runs no scripts below a folder with '$(odd)' in its path; move the project out of '$(CURDIR)')
endif
.PHONY: study quick paper report docs pictures bench score test test-all installations fuzz mutants lock clean help git FORCE

export PATH := $(CURDIR)/.venv/bin:$(PATH)
export OMP_NUM_THREADS := 1
export OPENBLAS_NUM_THREADS := 1
export PYTHONHASHSEED := 0
export MPLBACKEND := Agg

snakemake := python workflow/resume.py snakemake -j2 --workflow-profile workflow/profiles/default

study: .venv/ready  ## the whole study: results/, figures/, the numbers in documents (default)
	$(snakemake)

quick: .venv/ready  ## the small scene `quick` only
	$(snakemake) quick

paper: .venv/ready  ## paper.md and supplement.md as HTML and PDF: results/paper/, with what they show and no more
	$(snakemake) paper

docs: .venv/ready  ## pages for readers and the library's reference: build/docs/index.html
	sphinx-build -qWE -c docs . build/docs

pictures: .venv/ready  ## draw docs/pictures/ anew, by what the pages type
	python tests/pictures.py

report: study  ## figures, tables, the paper, rules and their times as one page: results/report.html
	python workflow/write_report.py results/report.html

test: git study  ## the study, linters, types, tests; then: are the committed results reproduced?
	ruff check
	ruff format --check
	lint-imports --no-cache
	snakefmt --check Snakefile workflow/rules
	mypy & types=$$!; pytest -n 2 --dist loadfile; tests=$$?; wait $$types && exit $$tests
	@changes=$$(git status --porcelain -- figures README.md paper.md supplement.md docs) || exit 1; \
	if [ -n "$$changes" ]; then \
	    echo "The study changed files in figures or docs, README.md, paper.md or supplement.md that git does not hold; look at them, then commit:" >&2; \
	    echo "$$changes" >&2; git --no-pager diff --stat HEAD -- figures README.md paper.md supplement.md docs >&2; exit 1; \
	fi
	@echo "figures, docs, README.md, paper.md and supplement.md are as committed."

test-all: export PYTEST_ADDOPTS := -m ""
test-all: test  ## the same with the tests that need Slurm or Chromium, which are skipped where these are missing

bench: .venv/ready  ## side by side with other solvers; `make bench sizes="32 64"` tries it (see benchmarks/README.md)
	python -m benchmarks $(sizes)
	python -m benchmarks.commands $(sizes)

score: .venv/ready  ## the drivers of other solvers in examples/, scored (see benchmarks/README.md)
	python -m benchmarks.scores

installations: .venv/ready  ## the core and each extra in empty environments, tried (some 10 minutes, needs the network)
	python -m benchmarks.installations

fuzz: .venv/ready  ## many more random problems against the certificate than `make test` tries (above an hour)
	UNILATERAL_FUZZ=60 pytest tests/unit/bounds/test_guarantees.py tests/unit/discrete/test_clamped.py

mutants: .venv/ready  ## one line of a guarantee spoilt at a time: a test has to fail; `make mutants only=tanh` tries one
	python -m tests.mutants $(only)

lock:  ## rewrite requirements.txt with the newest versions (needs uv)
	@command -v uv >/dev/null || { echo "make lock needs uv; type: python3 -m pip install uv" >&2; exit 1; }
	uv pip compile --quiet --universal --generate-hashes --no-emit-index-url --no-header --python-version 3.11 \
	    --extra study --extra docs --extra dev pyproject.toml --output-file requirements.txt.tmp
	mv requirements.txt.tmp requirements.txt

clean:  ## remove results/ and build/
	rm -rf results build

help:  ## this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "make %-13s %s\n", $$1, $$2 }' Makefile

git:
	@command -v git >/dev/null || { echo "make test needs git, and there is no git in PATH." >&2; exit 1; }
	@git rev-parse HEAD >/dev/null 2>&1 || { echo "make test needs a git clone with a commit, to compare the figures with." >&2; exit 1; }

# A .venv only works where it was made: the stamp holds that folder.
ifneq ($(shell cat .venv/installed 2>/dev/null),$(CURDIR))
.venv/installed: FORCE
endif
.venv/installed: requirements.txt pyproject.toml
	@sh setup.sh packages

.venv/ready: .venv/installed
	@sh setup.sh gmsh
