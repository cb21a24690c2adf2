"""Formulas as MathML, which browsers draw by themselves: no script, no font, no network."""

import re

from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml

FUNCTION = re.compile(r"(<mi>(?:log|ln|exp|sin|cos|max|min)</mi>)(?=\s*<m[in])")


def inline(translator, node):
    translator.body.append(_mathml(node, as_block=False))
    raise nodes.SkipNode


def block(translator, node):
    translator.body.append(f'<div class="math">{_mathml(node, as_block=True)}</div>')
    raise nodes.SkipNode


def _mathml(node, as_block):
    """The formula, with the space after names of functions that the converter leaves out."""
    return FUNCTION.sub(r'\1<mspace width="0.17em"/>', tex2mathml(node.astext(), as_block=as_block))


def setup(app):
    app.add_html_math_renderer("mathml", (inline, None), (block, None))
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
