"""The packages; all else is in pyproject.toml, which can find packages or list them, not both."""

from setuptools import find_packages, setup

setup(packages=[*find_packages("src"), "unilateral.checker", "unilateral.manufactured"])
