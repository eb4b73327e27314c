"""What Sphinx lacks here: MathML, docstrings that are plain text, links as the repository has them."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import yaml
from docutils import nodes
from latex2mathml.converter import convert
from sphinx.addnodes import pending_xref
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment
from sphinx.util.docutils import SphinxDirective
from sphinx.util.inspect import TypeAliasForwardRef
from sphinx.writers.html5 import HTML5Translator

import unilateral as ul

CODE = re.compile(r"`([^`]+)`")
MARKUP = re.compile(r"([\\*|_])")
UPRIGHT = re.compile("<mi>(&#x003(?:9[1-9A-F]|A[0-9]);)</mi>")
LINK = re.compile(r"\[([^\]]+)\]\(([^)#:\s]+)(#[\w-]+)?\)")
PAPERS = ("paper", "supplement")
VARIABLES = "src/study/variables.yaml"
HEAD = ["variable", "what it holds", "unit", "of the paper"]


def mathml(formula: str, display: str) -> str:
    """Capital Greek letters are upright, as TeX sets them."""
    return UPRIGHT.sub(r'<mi mathvariant="normal">\1</mi>', convert(formula, display=display))


def inline(translator: HTML5Translator, node: nodes.math) -> None:
    translator.body.append(f'<span class="math">{mathml(node.astext(), "inline")}</span>')
    raise nodes.SkipNode


def display(translator: HTML5Translator, node: nodes.math_block) -> None:
    translator.body.append(f'<div class="math">{mathml(node.astext(), "block")}</div>')
    raise nodes.SkipNode


def plain(_app: Sphinx, _what: str, _name: str, _of: Any, _options: Any, lines: list[str]) -> None:
    """A docstring has `code`, lists and examples; every other mark of reStructuredText is a letter."""
    if lines and lines[0].startswith("Alias for field number"):
        lines.clear()
    paragraphs = "\n".join(lines).split("\n\n")
    text = "\n\n".join(each if each.lstrip().startswith(">>>") else escaped(each) for each in paragraphs)
    lines[:] = text.split("\n")


def given(_app: Sphinx, what: str, name: str, of: Any, *_: Any) -> tuple[str, str] | None:
    """Of most classes only the library makes objects, so their constructors are not shown."""
    made_by_users = (ul.Polygon, ul.Solver, ul.Stop)
    hidden = what == "class" and of.__module__.startswith("unilateral.") and of not in made_by_users
    return ("", "") if hidden else None


def escaped(text: str) -> str:
    parts = CODE.split(text)
    parts[::2] = [MARKUP.sub(r"\\\1", part) for part in parts[::2]]
    parts[1::2] = [rf"\ ``{part}``\ " for part in parts[1::2]]
    return "".join(parts)


def public(app: Sphinx, env: BuildEnvironment, node: pending_xref, content: nodes.Element) -> Any:
    """A link to a class that users know by its name in `unilateral`, not by its module."""
    names = {f"unilateral.{module}.{name}": f"unilateral.{name}" for name, module in ul.PUBLIC.items()}
    target = names.get(node.get("reftarget", ""))
    python = env.domains.python_domain
    return target and python.resolve_xref(env, node["refdoc"], app.builder, "obj", target, node, content)


def within(app: Sphinx, page: str, source: list[str]) -> None:
    """Links that are right in the repository, made right among the pages.

    Those to the paper and its supplement lead to the typeset ones or, where these are not made, to the page
    about them. Those to folders, and to Markdown that is no page, become text.
    """
    here, papers = Path(app.srcdir, page).parent, [Path(app.srcdir, f"{name}.md") for name in PAPERS]

    def led(link: re.Match[str]) -> str:
        text, path, part = link.groups(default="")
        target = (here / path).resolve()
        if target in papers:
            typeset = f"typeset:{target.stem}.html{part}"
            return f"[{text}]({typeset if app.config.typeset_paper else 'paper.md'})"
        no_page = target.suffix == ".md" and app.env.path2doc(target) not in app.env.found_docs
        return text if target.is_dir() or (no_page and target.exists()) else link[0]

    source[0] = LINK.sub(led, source[0])


class Variables(SphinxDirective):
    """The variables of the study's tables, as a table."""

    def run(self) -> list[nodes.Node]:
        file = Path(self.env.srcdir, VARIABLES)
        self.env.note_dependency(str(file))
        rows = yaml.safe_load(file.read_text(encoding="utf-8")).items()
        return [table(HEAD, [[nodes.literal("", name), *map(nodes.Text, of)] for name, of in rows])]


def table(head: list[str], rows: list[list[nodes.Node]]) -> nodes.table:
    columns = [nodes.colspec(colwidth=1) for _ in head]
    body = nodes.tbody("", *map(row, rows))
    top = nodes.thead("", row([nodes.Text(name) for name in head]))
    return nodes.table("", nodes.tgroup("", *columns, top, body, cols=len(head)), classes=["colwidths-auto"])


def row(cells: list[nodes.Node]) -> nodes.row:
    return nodes.row("", *(nodes.entry("", nodes.paragraph("", "", cell)) for cell in cells))


def setup(app: Sphinx) -> dict[str, Any]:
    # Sphinx shows a type's short name inside of a union as TypeAliasForwardRef('Array').
    TypeAliasForwardRef.__repr__ = lambda alias: alias.name  # type: ignore[method-assign]
    app.add_config_value("typeset_paper", "", "env", types=str)
    app.add_html_math_renderer("mathml", (inline, None), (display, None))
    app.add_directive("variables", Variables)
    app.connect("autodoc-process-docstring", plain)
    app.connect("autodoc-process-signature", given)
    app.connect("missing-reference", public)
    app.connect("source-read", within)
    return {"parallel_read_safe": True}
