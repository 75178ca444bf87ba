"""The directive `file-reference`: keys of TOML files, generated from the tables of the reader.

A table of several kinds of files is written once, in the first file.
"""

from __future__ import annotations

import re
from importlib import import_module
from inspect import getdoc
from typing import Any

import msgspec
from msgspec import inspect
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

import octoplan

_WORDS = {
    inspect.FloatType: "number",
    inspect.IntType: "whole number",
    inspect.BoolType: "true or false",
    inspect.StrType: "text",
    inspect.AnyType: "anything",
    inspect.DictType: "table",
}


class FileReference(SphinxDirective):
    """Write each table of a file, a msgspec struct, with all keys."""

    required_arguments = 1

    def run(self) -> list[Any]:
        """Return a heading and a list of keys for each table."""
        module, name = self.arguments[0].rsplit(".", 1)
        info = msgspec.inspect.type_info(getattr(import_module(module), name))
        lines, written = [], self.env.temp_data.setdefault("file-reference", set())
        for place, table in _tables(info):
            like = next((own for own in table.cls.__mro__[1:] if own in written), None)
            if table.cls not in written:
                lines += _written(place, table, like)
                written.add(table.cls)
        return self.parse_text_to_nodes("\n".join(lines), allow_section_headings=True)


def _tables(info: Any) -> list[tuple[str, Any]]:
    """Return (key path, table) of a struct and of all structs inside, each once."""
    found: dict[Any, tuple[str, Any]] = {}

    def visit(place: str, table: Any) -> None:
        if table.cls in found:
            return
        found[table.cls] = (place, table)
        for field in table.fields:
            for inner, many in _structs(field.type):
                path = f"{place}.{field.encode_name}" if place else field.encode_name
                visit(f"{path}[]" if many else path, inner)

    visit("", info)
    return list(found.values())


def _structs(kind: Any, many: bool = False) -> list[tuple[Any, bool]]:
    """Return the structs of a type, and whether several are allowed."""
    if isinstance(kind, inspect.StructType):
        return [(kind, many)]
    if isinstance(kind, inspect.Metadata):
        return _structs(kind.type, many)
    if isinstance(kind, inspect.UnionType):
        found = [own for one in kind.types for own in _structs(one, many)]
        return sorted(found, key=lambda own: own[1])
    if isinstance(kind, inspect.ListType | inspect.VarTupleType):
        return _structs(kind.item_type, True)
    return []


def _written(place: str, table: Any, like: Any = None) -> list[str]:
    """Return a table as reStructuredText, without the keys of the table `like`."""
    title = _heading(place, table)
    told = table.cls.__doc__ or ""
    if like is not None:
        told = f'The keys that an obstacle of type "{table.tag}" has above, and one more.'
    lines = [title, "^" * len(title), "", _linked(told), ""]
    rows = [("Key", "Type", "Default", "Meaning")]
    if table.tag is not None:
        rows.append(("``type``", f'``"{table.tag}"``', "required", "kind of the table"))
    known = like.__struct_fields__ if like is not None else ()
    for field in (own for own in table.fields if own.name not in known):
        holds = _holds(field.type)
        rows.append((f"``{field.encode_name}``", holds, _default(field), _told(field.type)))
    lines += [".. list-table::", "   :header-rows: 1", "   :widths: 20 28 16 36", ""]
    for row in rows:
        lines += [f"   {'*' if i == 0 else ' '} - {cell}" for i, cell in enumerate(row)]
    return [*lines, ""]


def _linked(doc: str) -> str:
    """Return the docstring of a table; references become links with their first sentence."""
    text = " ".join(doc.split())

    def link(match: re.Match[str]) -> str:
        name = match[2]
        told = getdoc(getattr(octoplan, name, None)) if hasattr(octoplan, name) else None
        if told is None:
            return match[0]
        alone = match.start() == 0 and text[match.end() :][:1] != ":"
        first = " ".join(told.split("\n\n")[0].split())
        return f"{first * alone} {match[1]} :class:`~octoplan.{name}`".lstrip()

    return re.sub(r"\b(See|see) (?:\w+\.)*([A-Z]\w+)", link, text)


def _heading(place: str, table: Any) -> str:
    if not place:
        return "The file"
    name = place.removesuffix("[]").replace("[]", "")
    shown = f"[[{name}]]" if place.endswith("[]") else f"[{name}]"
    return shown if table.tag is None else f'{shown} of type "{table.tag}"'


def _told(kind: Any) -> str:
    """Return the description of a key, stored with its type."""
    if isinstance(kind, inspect.Metadata):
        own = (kind.extra_json_schema or {}).get("description", "")
        return str(own) or _told(kind.type)
    if isinstance(kind, inspect.UnionType):
        return next((told for told in map(_told, kind.types) if told), "")
    tables = _structs(kind)
    if len(tables) == 1:
        first = _linked(tables[0][0].cls.__doc__ or "").partition(". ")[0]
        return (first[:1].lower() + first[1:]).removesuffix(".")
    return "one of the types below" if tables else ""


def _default(field: Any) -> str:
    if field.required:
        return "required"
    value = field.default
    if value is msgspec.NODEFAULT or isinstance(value, msgspec.Struct) or value in (None, ()):
        return "none"
    shown = str(value).lower() if isinstance(value, bool) else f"{value!r}".replace("'", '"')
    return f"``{shown.replace('(', '[').replace(')', ']')}``"


def _holds(kind: Any) -> str:
    """Return the allowed type of a key in words."""
    if isinstance(kind, inspect.Metadata):
        return _holds(kind.type)
    if isinstance(kind, inspect.UnionType):
        parts = [_holds(one) for one in kind.types if not isinstance(one, inspect.NoneType)]
        return ", or ".join(dict.fromkeys(part for part in parts if part))
    if isinstance(kind, inspect.LiteralType):
        return ", ".join(f"``{json!r}``".replace("'", '"') for json in kind.values)
    if isinstance(kind, inspect.ListType | inspect.VarTupleType):
        inner = _holds(kind.item_type)
        if inner == "numbers, or number":
            return "numbers, flat or in rows"
        parts = [_plural(part) for part in inner.split(", or ")]
        return parts[0] if len(parts) == 1 else f"list of {' or '.join(parts)}"
    if isinstance(kind, inspect.TupleType):
        kinds = [_holds(one) for one in kind.item_types]
        if len(set(kinds)) > 1:
            return f"[{'; '.join(kinds)}]"
        return f"{len(kinds)} {_plural(kinds[0])}"
    if isinstance(kind, inspect.StructType):
        return "table"
    return _WORDS[type(kind)] + _range(kind)


def _plural(kind: str) -> str:
    """Return the plural of a type in words."""
    if kind[0].isdigit() or kind.startswith("numbers"):
        return f"rows of {kind}"
    if kind.startswith("``"):
        return f"list of {kind}"
    return re.sub(r"^(table|whole number|number)\b", r"\1s", kind)


def _range(kind: Any) -> str:
    signs = {"gt": "above", "ge": "from", "lt": "below", "le": "up to"}
    said = [f"{word} {getattr(kind, key, None):g}" for key, word in signs.items()
            if getattr(kind, key, None) is not None]  # fmt: skip
    return f" {', '.join(said)}" if said else ""


def setup(app: Sphinx) -> dict[str, bool]:
    """Add the directive."""
    app.add_directive("file-reference", FileReference)
    return {"parallel_read_safe": True}
