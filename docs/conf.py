"""The pages that `make docs` builds with Sphinx, from Markdown and the library's docstrings.

The folder of sources is the project's, so that a link between files is right here and where the repository is
shown. Nothing on a page comes from a network.
"""

import logging
import re
import sys
from pathlib import Path

from jupyter_client import KernelManager

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))

from unilateral import __version__  # noqa: E402
from unilateral.problems.problem import Problem  # noqa: E402
from unilateral.solution import certification  # noqa: E402

certification.Problem = Problem  # which it imports for types only

project = "unilateral"
author = project_copyright = "The unilateral developers"
version = release = __version__

extensions = ["myst_nb", "sphinx.ext.autodoc", "rendering"]
root_doc = "docs/index"
include_patterns = [
    "docs/*.md",
    "docs/notebooks/*.md",
    "manufactured/*.md",
    "benchmarks/*.md",
    "CONTRIBUTING.md",
    "CHANGELOG.md",
]
exclude_patterns = [".*", "build", "dist", "results", "src", "tests"]

myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 3
myst_url_schemes = {"http": None, "https": None, "typeset": "../{{path}}#{{fragment}}"}
highlight_language = "none"

# Notebooks are run. The kernel is spoken to in code, for it warns otherwise; its client tells nothing.
# The one about the study's tables is run if all of them are there; after `make quick` they are not.
KernelManager.transport_encryption.default_value = "auto"
logging.getLogger("traitlets").setLevel(logging.WARNING)
TABLES = "docs/notebooks/study-tables.md"
read = re.findall(r'"\.\./\.\./(results/[^"]+)"', (HERE.parent / TABLES).read_text(encoding="utf-8"))
results = all((HERE.parent / file).exists() for file in read)
if results:
    tags.add("results")  # noqa: F821  # of Sphinx, for `only`
nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_timeout = 60
nb_execution_excludepatterns = [] if results else [TABLES]
nb_merge_streams = True
suppress_warnings = ["myst-nb.lexer"]  # the kernel names it, and one that is not run has none
smartquotes = False

autodoc_member_order = "bysource"
aliases = ["Array", "ArrayLike", "Function", "Given", "Index"]
autodoc_type_aliases = {name: name for name in aliases}
autodoc_typehints_format = "short"
python_maximum_signature_line_length = 90
nitpicky = True
others = ["collections", "matplotlib", "numpy", "os", "pandas", "pd", "scipy", "sympy", "xarray", "xr"]
nitpick_ignore_regex = [
    ("py:.*", rf"({'|'.join(others)})\..*"),
    ("py:class", "|".join(["Axes", r"(.*\.)?DiscreteSolution", "Figure", *aliases])),
]

html_theme = "furo"
html_title = f"unilateral {release}"
html_math_renderer = "mathml"
html_static_path = ["static"]
html_css_files = ["pages.css"]
paper = HERE.parent / "results/paper"
typeset_paper = str(paper) if (paper / "supplement.html").exists() else ""
html_extra_path = ["site", *filter(None, [typeset_paper])]
html_copy_source = False
html_show_search_summary = False
