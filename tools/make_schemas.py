"""JSON Schema of the result files, made from their models.

Usage: python tools/make_schemas.py (`make reference`)

Every key that is always written is required.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from tccm_ros.results.models import (
    GraphFile,
    LabelsFile,
    ObjectsFile,
    PlanesFile,
    RacksFile,
    SignsFile,
    SummaryFile,
    SurfacesFile,
    TimingFile,
    TruthFile,
    WallsFile,
)

FILES: dict[str, type[Any]] = {
    "surfaces.json": SurfacesFile,
    "labels.json": LabelsFile,
    "objects.json": ObjectsFile,
    "racks.json": RacksFile,
    "walls.json": WallsFile,
    "signs.json": SignsFile,
    "graph.json": GraphFile,
    "planes.json": PlanesFile,
    "summary.json": SummaryFile,
    "timing.json": TimingFile,
    "truth.json": TruthFile,
}
"""Model of each JSON file; truth.json is only read, the others are written and read."""

FOLDER = Path(__file__).resolve().parents[1] / "docs" / "reference" / "schema"

DIALECT = "https://json-schema.org/draft/2020-12/schema"


def file_schema(name: str) -> dict[str, Any]:
    """Return the JSON Schema of one of `FILES`."""
    schema = TypeAdapter(FILES[name]).json_schema()
    if name != "truth.json":
        _require_all(schema)
    return {"$schema": DIALECT, **schema}


def _require_all(schema: dict[str, Any]) -> None:
    """Make every key required: readers have defaults, but the writer writes all keys."""
    for kind in (schema, *schema.get("$defs", {}).values()):
        if "properties" in kind:
            kind["required"] = list(kind["properties"])


def write_schemas(folder: Path) -> None:
    """Write ``<name>.schema.json`` of each file into a folder, made if needed."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in FILES:
        text = json.dumps(file_schema(name), indent=1, ensure_ascii=False) + "\n"
        (folder / f"{Path(name).stem}.schema.json").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    write_schemas(FOLDER)
