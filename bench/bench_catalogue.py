"""The catalogue with 100,000 surfaces: time of queries, of a map that is added, and of gathering.

Usage: python bench/bench_catalogue.py
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import shapely

from tccm_ros.fleet.catalogue import MAX_FILES, Catalogue
from tccm_ros.fleet.tables import TABLES

RUNS = 9
QUERIES = {
    "tables 0.7 to 0.8 m high, 0.5 m2 free, last day": """
        SELECT map, id, free_area FROM surfaces WHERE label = 'table'
        AND height_above_floor BETWEEN 0.7 AND 0.8 AND free_area >= 0.5
        AND last_seen > (SELECT max(last_seen) FROM surfaces) - INTERVAL 1 DAY""",
    "surfaces and free area by height": """
        SELECT round(height_above_floor, 1) AS height, count(*), sum(free_area)
        FROM surfaces GROUP BY ALL ORDER BY height""",
    "one map's surfaces, with outlines": """
        SELECT id, label, geometry FROM surfaces WHERE map = 'run-00042'""",
}


def write_surfaces(catalogue: Catalogue, maps: int, surfaces: int, own_files: int) -> None:
    """Write a catalogue; the last `own_files` maps have files of their own."""
    rng = np.random.default_rng(0)
    table = next(table for table in TABLES if table.name == "surfaces")
    outlines = [shapely.to_wkb(shapely.Point(0, 0).buffer(r, 8)) for r in rng.uniform(0.2, 2, 500)]

    def rows(first: int, last: int) -> pa.Table:
        count = (last - first) * surfaces
        known = {
            "map": [f"run-{k:05d}" for k in range(first, last) for _ in range(surfaces)],
            "folder": ["/fleet"] * count,
            "id": np.tile(np.arange(surfaces), last - first),
            "label": rng.choice(["table", "counter", "shelf", "floor"], count),
            "geometry": [outlines[k] for k in rng.integers(0, len(outlines), count)],
        }
        arrays = [
            pa.array(known.get(field.name, _random(rng, count, field.type)), field.type)
            for field in table.schema
        ]
        return pa.Table.from_arrays(arrays, schema=table.schema)

    folder = catalogue.path / table.name
    folder.mkdir(parents=True)
    for k in range(maps - own_files, maps):
        pq.write_table(rows(k, k + 1), folder / f"run-{k:05d}.parquet")
    pq.write_table(rows(0, maps - own_files), catalogue.path / f"{table.name}.parquet")


def _random(rng: np.random.Generator, count: int, kind: pa.DataType) -> list[Any] | np.ndarray:
    """Return random values of a column."""
    values = rng.uniform(0.0, 2.0, count)
    if pa.types.is_timestamp(kind):
        return (1.7e15 + values * 1.3e12).astype(np.int64)
    if pa.types.is_integer(kind):
        return (values * 1000).astype(np.int64)
    if pa.types.is_boolean(kind):
        return values > 1.0
    return values if pa.types.is_floating(kind) else [f"{value:.1f}" for value in values]


def median_ms(call: Callable[[], object]) -> str:
    """Return the median times of some calls on the clock and of the processors, ms."""
    times = []
    for _ in range(RUNS):
        start = time.perf_counter(), time.process_time()
        call()
        times.append((time.perf_counter() - start[0], time.process_time() - start[1]))
    clock, processor = 1e3 * np.median(times, axis=0)
    return f"{clock:.0f} ({processor:.0f})"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--maps", type=int, default=10_000)
    parser.add_argument("--surfaces", type=int, default=10, help="of each map")
    arguments = parser.parse_args()
    total = arguments.maps * arguments.surfaces
    print(f"| query of {total} surfaces | gathered | {MAX_FILES} maps not gathered yet |")
    print("|---|---|---|\n| | ms (of the processors) | ms (of the processors) |")
    with tempfile.TemporaryDirectory() as one, tempfile.TemporaryDirectory() as other:
        catalogues = [Catalogue(Path(folder) / "catalogue") for folder in (one, other)]
        for catalogue, own in zip(catalogues, (0, MAX_FILES)):
            write_surfaces(catalogue, arguments.maps, arguments.surfaces, own)
        for name, query in QUERIES.items():
            times = [median_ms(partial(catalogue.ask, query)) for catalogue in catalogues]
            print(f"| {name} | {times[0]} | {times[1]} |")
        start = time.perf_counter()
        catalogues[1].gather(max_files=0)
        print(f"\ngathering {MAX_FILES} maps: {time.perf_counter() - start:.2f} s")


if __name__ == "__main__":
    main()
