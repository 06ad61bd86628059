"""Open the report of a result folder in the browser, and write the report of a saved map."""

from __future__ import annotations

import webbrowser
from collections.abc import Callable
from pathlib import Path

from tccm_ros.atomic import output_folder
from tccm_ros.config import Config
from tccm_ros.errors import MapError, OutputError
from tccm_ros.mapping.surface_slam import SurfaceSlam
from tccm_ros.report.html_report import write_page, write_report
from tccm_ros.report.pictures import write_pictures
from tccm_ros.results.exports import write_solution
from tccm_ros.results.folder_reader import load_results
from tccm_ros.results.map_file import load_map

REPORT = "report.html"


def view(target: Path | str, *, open_page: Callable[[str], object] = webbrowser.open) -> Path:
    """Open the report of a result folder in the browser; write it first if it is missing.

    Parameters
    ----------
    target
        A result folder, or a report.html.
    open_page
        Opens a URL; returns False on failure.

    Returns
    -------
    Path
        The report.

    Raises
    ------
    MapError
        If the target is missing, of another kind, or damaged.
    OutputError
        If the report cannot be written, or no browser opens (the message has its path).
    """
    report = find_report(Path(target))
    if open_page(report.resolve().as_uri()) is False:
        raise OutputError(f"{report}: no browser opens here; open this file in one")
    return report


def find_report(target: Path) -> Path:
    """Return the report of a result folder; write it if it is missing or older than the map.

    Raises
    ------
    MapError, OutputError
        As `view`.
    """
    if target.is_file() and target.suffix == ".html":
        return target
    surfaces = target / "surfaces.json"
    if not surfaces.is_file():
        raise MapError(
            f"{target}: no surfaces.json here; expected a folder that 'tccm replay --out' wrote"
        )
    report = target / REPORT
    if report.is_file() and report.stat().st_mtime >= surfaces.stat().st_mtime:
        return report
    return write_report(target)


def report_map(saved: Path | str, folder: Path | str, config: Config | None = None) -> Path:
    """Write the surfaces, walls, trajectory, pictures and report of a saved map.

    Parameters
    ----------
    saved
        A saved map of ``~/save_map`` or ``tccm replay``.
    folder
        Folder of the files; created if needed.
    config
        Configuration of the map; the defaults if None.

    Returns
    -------
    Path
        The report, for `view`.

    Raises
    ------
    MapError
        If the map is missing, damaged or of another version.
    OutputError
        If the folder cannot be written.
    """
    config = config or Config()
    solution = SurfaceSlam.from_saved(config, load_map(saved)).solve()
    with output_folder(folder) as made:
        write_solution(made, solution, config)
        results = load_results(made)
        write_page(results, write_pictures(results, made), made)
    return Path(folder) / REPORT
