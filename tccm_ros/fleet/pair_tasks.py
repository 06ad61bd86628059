"""Match pairs of maps as tasks, each once; earlier matches are cached."""

from __future__ import annotations

import hashlib
import itertools
from collections.abc import Mapping
from concurrent.futures import CancelledError
from pathlib import Path

from distributed import Client, as_completed
from distributed.scheduler import KilledWorker

from tccm_ros.config import Config
from tccm_ros.errors import FleetError, one_line
from tccm_ros.fleet.cluster import Workers, connected
from tccm_ros.fleet.map_inputs import read_map
from tccm_ros.fleet.pair_matching import PairMatch, match_maps
from tccm_ros.fleet.pair_selection import Pair
from tccm_ros.fleet.record import settings_checksum, software_checksum
from tccm_ros.progress import Bars
from tccm_ros.results.folder_reader import read_json_or_none
from tccm_ros.results.numbers import write_json


def match_all(
    maps: Mapping[int, tuple[Path, str]],
    cache: Path,
    config: Config,
    workers: Workers,
    bars: Bars,
) -> tuple[dict[Pair, PairMatch], int]:
    """Return the match of each pair, and the number of pairs matched in this run.

    Parameters
    ----------
    maps
        Map file and checksum, by index.
    cache
        Cache folder of matches; new ones are added.
    config
        Configuration of matching.
    workers
        Workers to use.
    bars
        Progress bars.

    Raises
    ------
    FleetError
        If no worker could match a pair.
    MapError
        If a map is damaged or has no walls.
    """
    files = {
        (i, j): pair_file(cache, maps[i][1], maps[j][1], config)
        for i, j in itertools.combinations(sorted(maps), 2)
    }
    missing = [pair for pair, file in files.items() if read_json_or_none(file, PairMatch) is None]
    bars.start("match", float(len(missing)), "pairs")
    if missing:
        with connected(workers) as client:
            _run(client, missing, maps, files, config, bars)
    return {pair: _cached_pair(file) for pair, file in files.items()}, len(missing)


def _run(
    client: Client,
    pairs: list[Pair],
    maps: Mapping[int, tuple[Path, str]],
    files: Mapping[Pair, Path],
    config: Config,
    bars: Bars,
) -> None:
    futures = {
        client.submit(match_files, maps[i][0], maps[j][0], config, files[i, j], pure=False): (i, j)
        for i, j in pairs
    }
    for future in as_completed(futures):
        try:
            future.result()
        except (KilledWorker, CancelledError) as error:
            i, j = futures[future]
            raise FleetError(f"{maps[i][0]} and {maps[j][0]}: {one_line(error)}") from None
        bars.advance(1.0)


def _cached_pair(file: Path) -> PairMatch:
    match = read_json_or_none(file, PairMatch)
    if match is None:
        raise FleetError(f"{file}: the match of two maps is not there; run the command again")
    return match


def pair_file(folder: Path, one: str, other: str, config: Config) -> Path:
    """Return the cache file of a match.

    Parameters
    ----------
    folder
        Folder of the cache.
    one, other
        Checksums of the maps.
    config
        Configuration of the match.
    """
    key = "".join((one, other, settings_checksum(config), software_checksum()))
    return folder / f"{hashlib.sha256(key.encode()).hexdigest()}.json"


def match_files(one: Path, other: Path, config: Config, cache: Path) -> None:
    """Match the maps of two files and cache the result (a task).

    Parameters
    ----------
    one, other
        Map files.
    config
        Configuration of the match.
    cache
        Cache file.
    """
    match = match_maps(read_map(one, config), read_map(other, config), config)
    write_json(cache, match)
