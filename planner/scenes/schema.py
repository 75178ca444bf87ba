"""The JSON Schema of scene files, for editors: generated from the tables that read them."""

from __future__ import annotations

from typing import Any

import msgspec

from planner.scenes.tables import SceneTable

DIALECT = "https://json-schema.org/draft/2020-12/schema"


def scene_schema() -> dict[str, Any]:
    """Return the JSON Schema of a scene file: keys, types and ranges.

    What depends on several keys, such as a place beyond the arm's tip, only `load` knows.
    """
    schema = msgspec.json.schema(SceneTable)
    return {"$schema": DIALECT, "title": "octoplan scene", **schema}
