"""A saved map as named arrays, and back: what is in the file, whatever its form."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tccm_ros.surfaces.continuation import Continuation, LastSample
from tccm_ros.surfaces.saved_map import SavedMap, SavedView, pack_views, unpack_views

__all__ = ["map_of_arrays", "map_to_arrays"]

Arrays = dict[str, NDArray[Any]]


def map_to_arrays(saved: SavedMap) -> Arrays:
    """Return a map's arrays: ``map/...``, and ``run/...`` of the run that it was saved in."""
    arrays = {f"map/{name}": array for name, array in _pack(saved).items()}
    if saved.run is not None:
        arrays |= {f"run/{name}": array for name, array in _pack_run(saved.run).items()}
    return arrays


def map_of_arrays(arrays: Mapping[str, NDArray[Any]]) -> SavedMap:
    """Return the map of `map_to_arrays`.

    Raises
    ------
    MapError, ValueError, KeyError, TypeError
        Where arrays are missing or do not fit together.
    """
    map_, run = _group(arrays, "map/"), _group(arrays, "run/")
    return _unpack(map_, _unpack_run(run) if run else None)


def _group(arrays: Mapping[str, NDArray[Any]], prefix: str) -> Arrays:
    return {n.removeprefix(prefix): a for n, a in arrays.items() if n.startswith(prefix)}


def _pack(saved: SavedMap) -> Arrays:
    views = pack_views([s.view for s in saved.views])
    return {
        "about": _text({"views": len(saved.views)}),
        **{f"walls/{name}": array for name, array in sorted(saved.walls.items())},
        **{f"views/{name}": array for name, array in sorted(views.items())},
        "anchor/keyframe": np.array([s.keyframe for s in saved.views], np.int64),
        "anchor/hangs": np.array([s.hangs for s in saved.views], bool),
        "anchor/T": np.array([s.T_anchor_view for s in saved.views], float).reshape(-1, 4, 4),
        "anchor/cov_tilt": np.array([s.cov_tilt for s in saved.views], float).reshape(-1, 3, 3),
    }


def _unpack(arrays: Arrays, run: Continuation | None) -> SavedMap:
    anchors = _group(arrays, "anchor/")
    views = unpack_views(_group(arrays, "views/"))
    names = anchors["keyframe"].tolist(), anchors["hangs"].tolist()
    rows = zip(views, *names, anchors["T"], anchors["cov_tilt"], strict=True)
    return SavedMap(_group(arrays, "walls/"), tuple(SavedView(*row) for row in rows), run)


def _pack_run(run: Continuation) -> Arrays:
    about = {
        "software": run.software,
        "configuration": run.configuration,
        "last": run.last.to_json(),
    }
    return {"about": _text(about), **{f"state/{name}": a for name, a in run.state.items()}}


def _unpack_run(arrays: Arrays) -> Continuation:
    about = json.loads(arrays["about"].tobytes())
    return Continuation(
        about["software"],
        about["configuration"],
        LastSample.from_json(about["last"]),
        _group(arrays, "state/"),
    )


def _text(about: Mapping[str, Any]) -> NDArray[np.uint8]:
    return np.frombuffer(json.dumps(about, sort_keys=True).encode(), np.uint8)
