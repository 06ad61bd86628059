"""Write the data files of a result folder; byte-identical for the same run."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from tccm_ros.atomic import write_output
from tccm_ros.config import Config
from tccm_ros.cuboids.cuboids import Cuboids
from tccm_ros.mapping.surface_slam import SurfaceSolution
from tccm_ros.mapping.tccm import CycleResult
from tccm_ros.results.cuboids_file import cuboids_archive
from tccm_ros.results.geojson import feature_collection
from tccm_ros.results.models import (
    CompartmentEntry,
    CycleEntry,
    GraphFile,
    LabelsFile,
    ObjectsFile,
    PlacementsEntry,
    PlanesFile,
    RacksFile,
    SignsFile,
    SurfacesFile,
    WallsFile,
)
from tccm_ros.results.numbers import json_text
from tccm_ros.results.planning import scene_text
from tccm_ros.results.ply import surface_ply
from tccm_ros.results.trajectory import Trajectory
from tccm_ros.scene.planning_shapes import scene_shapes
from tccm_ros.scene.queries import SurfaceFilter, SurfaceQueries
from tccm_ros.tabletop.placements import Placement, PlacementRequest

PLACED_HEIGHT_M = 0.2
"""Object height for the placements in objects.json, m. Chosen: a bottle, lower than the spacing of
shelf boards."""

MAX_PLACEMENTS = 20
"""Maximum number of placements in objects.json. Chosen: more than a robot tries."""


def write_results(
    folder: Path,
    solution: SurfaceSolution,
    cycles: Sequence[CycleResult],
    cuboids: Cuboids,
    config: Config,
) -> None:
    """Write the data files of a run into a folder (see `output_folder`).

    Parameters
    ----------
    folder
        An existing folder; the files are written under their final names.
    solution
        Solution with trajectory, walls and surfaces.
    cycles
        All tilt cycles, in order.
    cuboids
        The final integration map.
    config
        Groups ``frames``, ``map`` and ``planes``.

    Raises
    ------
    OutputError
        If a file cannot be written.
    """
    write_solution(folder, solution, config)
    odom = cycles[-1].frame_id if cycles else config.frames.odom_name
    models = {"planes.json": PlanesFile(tuple(map(CycleEntry.of, cycles)))}
    _write(folder, _encoded(models) | {"cuboids.npz": cuboids_archive(cuboids, config, odom)})


def write_solution(folder: Path, solution: SurfaceSolution, config: Config) -> None:
    """Write surfaces, objects, walls, graph and trajectory of a solution.

    Parameters
    ----------
    folder
        An existing folder; the files are written under their final names.
    solution
        Solution with trajectory, walls and surfaces.
    config
        Group ``frames``.

    Raises
    ------
    OutputError
        If a file cannot be written.
    """
    _write(folder, solution_files(solution, config))


def solution_files(solution: SurfaceSolution, config: Config) -> dict[str, bytes]:
    """Return the contents of the files of `write_solution` by name."""
    map_frame, graph, stages = config.frames.map_name, solution.graph, solution.stages
    request = PlacementRequest(*solution.place_size, PLACED_HEIGHT_M, max_count=MAX_PLACEMENTS)
    found = stages.run("placements", lambda: ranked_placements(solution, request)) or []
    placements = PlacementsEntry.of(request, found)
    models = {
        "surfaces.json": SurfacesFile.of(
            solution.surfaces, solution.floor_z, map_frame, solution.rooms
        ),
        "labels.json": LabelsFile.of(solution.corrected_labels),
        "walls.json": WallsFile(tuple(graph.walls)),
        "objects.json": ObjectsFile.of(solution.objects, solution.free_places, placements),
        "racks.json": RacksFile(tuple(map(CompartmentEntry.of, solution.compartments))),
        "signs.json": SignsFile.of(graph.signs, graph.refused_signs),
        "graph.json": GraphFile.of(graph.keyframes, graph.loops, graph.landmarks),
    }
    trajectory = Trajectory(solution.trajectory_ns, solution.T_map_base)
    files = {
        "surfaces.ply": surface_ply(solution.mapped.points, solution.mapped.surface_id),
        "trajectory.tum": trajectory.tum().encode(),
    }
    exports: dict[str, Callable[[], bytes]] = {
        "surfaces.geojson": lambda: _json(
            feature_collection(solution.surfaces, graph.walls, map_frame)
        ),
        "surfaces.scene": lambda: scene_text(
            scene_shapes(
                solution.surfaces, solution.objects, solution.compartments, solution.unseen
            )
        ).encode(),
    }
    made = {name: stages.run(name, export) for name, export in exports.items()}
    return _encoded(models) | files | {k: data for k, data in made.items() if data is not None}


def ranked_placements(solution: SurfaceSolution, request: PlacementRequest) -> list[Placement]:
    """Return the positions where an object can be put down, as ``~/find_placements`` does.

    Parameters
    ----------
    solution
        Solution with the surfaces, and the objects on them.
    request
        The object.
    """
    queries = SurfaceQueries(
        solution.surfaces, solution.objects, solution.floor_z, solution.compartments
    )
    return queries.find_placements(SurfaceFilter(), request)


def _encoded(models: Mapping[str, Any]) -> dict[str, bytes]:
    return {name: _json(model) for name, model in models.items()}


def _json(model: Any) -> bytes:
    return json_text(model).encode()


def _write(folder: Path, files: Mapping[str, bytes]) -> None:
    for name, content in files.items():
        write_output(folder / name, content)
