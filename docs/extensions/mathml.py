"""Render formulas as MathML, which browsers draw without a network.

conf.py loads this extension; latex2mathml translates the formulas.
"""

from __future__ import annotations

from typing import Any
from xml.etree import ElementTree

from docutils import nodes
from latex2mathml.converter import convert
from sphinx.application import Sphinx
from sphinx.util.math import get_node_equation_number
from sphinx.writers.html5 import HTML5Translator

MATHML = "http://www.w3.org/1998/Math/MathML"
ElementTree.register_namespace("", MATHML)


def translated(text: str, display: str = "inline") -> str:
    """Return a formula as MathML, with the spacing of TeX.

    The font raises primes, so that superscripts of primes are removed. A minus without a term on
    the left is a prefix. Bars and slashes have no spaces.
    """
    tree = ElementTree.fromstring(convert(text, display=display))
    for part in list(tree.iter()):
        if len(part) and part[-1].text == "\u2032":
            prime = part[-1]
            prime.tag = f"{{{MATHML}}}mo"
            prime.set("form", "postfix")
            if len(part) == 3:
                below = ElementTree.Element(f"{{{MATHML}}}msub")
                below.extend(part[:2])
                part[:2] = [below]
            part.tag = f"{{{MATHML}}}mrow"
        for before, sign in zip([None, *part], part, strict=False):
            if sign.text in {"|", "/", "\u2016"}:
                sign.attrib |= {"lspace": "0", "rspace": "0"}
            if sign.text == "\u2212" and (before is None or before.text in {"=", "(", ","}):
                sign.set("form", "prefix")
    return ElementTree.tostring(tree, encoding="unicode")


def inline(translator: HTML5Translator, node: nodes.math) -> None:
    """Write an inline formula."""
    translator.body.append(translated(node.astext()))
    raise nodes.SkipNode


def block(translator: HTML5Translator, node: nodes.math_block) -> None:
    """Write a displayed formula with the number at the right."""
    translator.body.append(translator.starttag(node, "div", CLASS="math"))
    if node["number"]:
        number = get_node_equation_number(translator, node)
        translator.body.append(f'<span class="eqno">({number})')
        translator.add_permalink_ref(node, "Link to this equation")
        translator.body.append("</span>")
    text = node.astext().strip()
    if r"\\" in text:
        text = rf"\begin{{split}}{text}\end{{split}}"
    translator.body.append(translated(text, "block") + "</div>\n")
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, Any]:
    """Add the renderer under the name mathml."""
    app.add_html_math_renderer("mathml", (inline, None), (block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
