"""The packages; all else is in pyproject.toml, which can find packages or list them, not both."""

from setuptools import find_packages, setup

LIBRARY = find_packages("src", include=["unilateral*"])  # and not the study, which stands beside it

setup(packages=[*LIBRARY, "unilateral.checker", "unilateral.manufactured"])
