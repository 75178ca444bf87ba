"""Elements of XML with numbers in them."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np


def inside(parent: ET.Element, tag: str, **attributes: object) -> ET.Element:
    """Return a new element inside another; numbers are written in full, lists with blanks.

    An attribute that is a word of Python's ends in _ here.
    """
    texts = {key.rstrip("_"): _text(value) for key, value in attributes.items()}
    return ET.SubElement(parent, tag, texts)


def written(root: ET.Element) -> str:
    """Return a document as text, indented."""
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"


def _text(value: object) -> str:
    if isinstance(value, str):
        return value
    return " ".join(f"{float(x):.15g}" for x in np.ravel(np.asarray(value, dtype=float)))
