"""XML elements with numbers in full precision."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np


def child_of(parent: ET.Element, tag: str, **attributes: object) -> ET.Element:
    """Return a new child element; numbers are in full precision, lists separated by blanks."""
    return ET.SubElement(parent, tag, {key: _text(value) for key, value in attributes.items()})


def remark(parent: ET.Element, *sentences: str) -> None:
    """Append each sentence as a comment."""
    parent.extend(ET.Comment(f" {sentence} ") for sentence in sentences)


def _text(value: object) -> str:
    if isinstance(value, str):
        return value
    return " ".join(f"{float(x):.15g}" for x in np.ravel(np.asarray(value, dtype=float)))


def to_text(root: ET.Element) -> str:
    """Return an indented document as text."""
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"
