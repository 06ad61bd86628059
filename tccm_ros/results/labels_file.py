"""labels.json beside a saved map: the labels corrected by a user, who may edit the file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from tccm_ros.errors import MapError
from tccm_ros.mapping.saved_map import SavedMap
from tccm_ros.results.folder_reader import read_json
from tccm_ros.results.models import LabelsFile
from tccm_ros.surfaces.labels.corrected_labels import label_to_give, with_corrected_labels
from tccm_ros.surfaces.labels.labels import SurfaceLabel

MAP_FILE, LABELS_FILE = "map.mcap", "labels.json"
"""Names of a saved map and of its labels file."""


def labels_beside(map_path: Path) -> dict[int, SurfaceLabel] | None:
    """Return the labels of the labels.json beside a map.mcap, by surface id; None without the file.

    Raises
    ------
    MapError
        If the file is damaged, or has an unknown label or a surface twice.
    """
    path = map_path.with_name(LABELS_FILE)
    if map_path.name != MAP_FILE or not path.exists():
        return None
    labels: dict[int, SurfaceLabel] = {}
    for entry in read_json(path, LabelsFile).labels:
        if entry.surface in labels:
            raise MapError(f"{path}: surface {entry.surface} twice")
        try:
            labels[entry.surface] = label_to_give(entry.label)
        except MapError as error:
            raise MapError(f"{path}: surface {entry.surface}: {error}") from None
    return labels


def with_labels(saved: SavedMap, labels: Mapping[int, SurfaceLabel] | None) -> SavedMap:
    """Return a saved map with the given corrected labels and no others.

    Parameters
    ----------
    saved
        The map.
    labels
        By surface id; None to keep the labels of the map.

    Raises
    ------
    MapError
        If a surface is not in the map.
    """
    if labels is None:
        return saved
    views = with_corrected_labels([s.view for s in saved.views], labels)
    return replace(saved, views=tuple(replace(s, view=v) for s, v in zip(saved.views, views)))
