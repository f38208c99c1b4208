"""Sphinx settings of the docs site; `make docs` lays its sources out by docs/site/pages.py."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

from docutils.nodes import SkipNode
from docutils.utils.math.latex2mathml import tex2mathml

REPOSITORY = Path(__file__).resolve().parents[2]
_PROJECT = tomllib.loads((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))["project"]

project, release = "crux", _PROJECT["version"]
copyright = "the authors of crux, Apache License 2.0"
extensions = ["myst_parser", "sphinx.ext.autodoc"]
include_patterns = ["*.md", "docs/*.md", "can/*.md", "faults/*.md", "examples/README.md", "msgs/**.md", "planner/**.md"]
include_patterns += ["runtime/README.md", "firmware/README.md", "tools/README.md", "tests/README.md"]
html_theme = "furo"
html_title = f"crux {release}"
html_static_path = ["landing.css"]
html_css_files = ["landing.css"]
html_show_sourcelink = False
html_copy_source = False
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 4
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_class_signature = "separated"
python_use_unqualified_type_names = True
nitpicky = False


def _plain(_app: Any, _kind: str, _name: str, _thing: Any, _options: Any, lines: list[str]) -> None:
    """Docstrings are prose with `names` in it: nothing in them is markup."""
    text = "\n".join(line.strip() for line in lines)
    parts = re.split(r"(`[^`\n]+`)", text)
    parts = [f"`{part}`" if part.startswith("`") else re.sub(r"([\\*|_<>])", r"\\\1", part) for part in parts]
    lines[:] = "".join(parts).split("\n")


def _mathml(translator: Any, node: Any) -> None:
    """Formulas as MathML, which browsers draw by themselves: no script, no network."""
    is_block = node.tagname == "math_block"
    translator.body.append(tex2mathml(node.astext(), as_block=is_block))
    raise SkipNode


def setup(app: Any) -> None:
    app.connect("autodoc-process-docstring", _plain)
    app.add_html_math_renderer("mathml", inline_renderers=(_mathml, None), block_renderers=(_mathml, None))


html_math_renderer = "mathml"
