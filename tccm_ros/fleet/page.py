"""HTML page of a fleet: a single file with a row per recording, which loads only pictures.

Its pictures and reports are the files in the folders of the recordings.
"""

from __future__ import annotations

import json
from dataclasses import astuple, dataclass, fields
from importlib.resources import files
from pathlib import Path
from string import Template

from tccm_ros.atomic import write_output
from tccm_ros.fleet.layout import RECORD, FleetFolder
from tccm_ros.fleet.record import DoneRecord, Failure
from tccm_ros.results.folder_reader import read_json_or_none


@dataclass(frozen=True, slots=True)
class RecordingRow:
    """A recording on the page; unknown values are None.

    Attributes
    ----------
    name, source
        Name and source of the recording.
    state
        ``done`` or ``failed``.
    reason
        Reason for a failure.
    has_results, pictures
        Whether there are results, with pictures.
    start, duration
        Start stamp and duration of the recording, s.
    surfaces, objects, walls, loops, dropped
        Counts from the replay.
    seconds
        Duration of the replay, s.
    """

    name: str
    source: str
    state: str
    reason: str
    has_results: bool
    pictures: bool
    start: float | None = None
    duration: float | None = None
    surfaces: int | None = None
    objects: int | None = None
    walls: int | None = None
    loops: int | None = None
    dropped: int | None = None
    seconds: float | None = None


def fleet_rows(folder: FleetFolder) -> list[RecordingRow]:
    """Return a row for each recording of a fleet, sorted by name.

    Parameters
    ----------
    folder
        Folder of the fleet.
    """
    rows = {}
    for path in _entries(folder.recordings):
        record = read_json_or_none(path / RECORD, DoneRecord)
        if record is not None:
            rows[path.name] = _done(path, record)
    for path in _entries(folder.failures):
        failure, name = read_json_or_none(path, Failure), path.stem
        if failure is not None:
            older = rows.get(name)
            has_results, pictures = (older.has_results, older.pictures) if older else (False, False)
            rows[name] = RecordingRow(
                name, failure.source, "failed", str(failure), has_results, pictures
            )
    return [rows[name] for name in sorted(rows)]


def _entries(folder: Path) -> list[Path]:
    if not folder.is_dir():
        return []
    return sorted(path for path in folder.iterdir() if not path.name.startswith("."))


def _done(path: Path, record: DoneRecord) -> RecordingRow:
    counts = record.counts
    return RecordingRow(
        path.name,
        record.source,
        "done",
        "",
        True,
        (path / "map.png").exists(),
        record.start,
        record.bag_duration,
        counts.surfaces,
        counts.objects,
        counts.walls,
        counts.loops_accepted,
        sum(counts.dropped.values()),
        record.cost.seconds,
    )


def write_page(folder: FleetFolder) -> Path:
    """Write the page of a fleet and return its path.

    Parameters
    ----------
    folder
        Folder of the fleet.

    Raises
    ------
    OutputError
        If the page cannot be written.
    """
    write_output(folder.page, page_text(fleet_rows(folder), folder.path.name))
    return folder.page


def page_text(rows: list[RecordingRow], name: str) -> str:
    """Return the HTML text of a page.

    Parameters
    ----------
    rows
        Rows of the recordings.
    name
        Name of the fleet.
    """
    tree = {
        "columns": [f.name for f in fields(RecordingRow)],
        "rows": [astuple(row) for row in rows],
    }
    data = json.dumps(tree, ensure_ascii=False, separators=(",", ":")).replace("<", "\\u003c")
    viewer = files("tccm_ros.fleet") / "viewer"
    parts = {n: (viewer / f"page.{n}").read_text(encoding="utf-8") for n in ("html", "css", "js")}
    title = f"Fleet {name}".replace("&", "&amp;").replace("<", "&lt;")
    return Template(parts["html"]).substitute(
        title=title, style=parts["css"].strip(), script=parts["js"].strip(), data=data
    )
