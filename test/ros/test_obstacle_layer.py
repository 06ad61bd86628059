"""What the guide writes for Nav2's obstacle layers marks what stands and clears what has left."""

import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import yaml
from fed import fed_tccm
from mapped_room import FLOOR, HALF_TIME, LASER, TABLE, WALL, record, settings
from obstacle_layer import FREE, LETHAL, ObstacleLayer, Source
from scipy.ndimage import maximum_filter

from tccm_ros.bags.typestore import TypestoreMessages
from tccm_ros.ros.pointcloud import POINT_ROW, cloud_rows
from tccm_ros.ros.topic_messages import CycleMessageBuilder

GUIDE = Path(__file__).resolve().parents[2] / "docs" / "guides" / "moveit_nav2.md"
WINDOW = 2
"""Tilt cycles that the map holds: a table that has left is forgotten after so many."""

WITH_TABLE, WITHOUT = 4, 5
"""Tilt cycles."""


@cache
def clouds() -> list[np.ndarray]:
    """Return the points of ~/obstacles of each tilt cycle; the table leaves before the fifth."""
    leaves = WITH_TABLE * HALF_TIME

    def boxes_at(t):
        return (FLOOR, WALL, TABLE) if t < leaves else (FLOOR, WALL)

    config = settings(map={"window_cycles": WINDOW})
    fed, types = fed_tccm(config), TypestoreMessages()
    builder, made = CycleMessageBuilder(types, config), []
    for item in record(leaves + WITHOUT * HALF_TIME, boxes_at, noise=0.002, every=2):
        for result in fed.add(item):
            messages = {m.topic: m for m in builder.of(result, fed.processor.map.cuboids)}
            rows = cloud_rows(messages["obstacles"].build(), POINT_ROW)
            made.append(np.column_stack([rows["x"], rows["y"], rows["z"]]).astype(float))
    return made


def written_sources() -> dict[str, dict]:
    """Return the observation sources that the guide writes."""
    blocks = re.findall(r"```yaml\n(.*?)```", GUIDE.read_text(), re.DOTALL)
    (tree,) = (yaml.safe_load(block) for block in blocks if "observation_sources" in block)
    layer = tree["local_costmap"]["local_costmap"]["ros__parameters"]["voxel_layer"]
    return {name: layer[name] for name in layer["observation_sources"].split()}


def states(names: list[str]) -> list[ObstacleLayer]:
    """Return the layer with some of the guide's sources after each tilt cycle."""
    layer, found = ObstacleLayer([Source.of(written_sources()[name]) for name in names]), []
    for points in clouds():
        layer.update(np.array(LASER), points)
        found.append(ObstacleLayer(layer.sources))
        found[-1].cells = layer.cells.copy()
    return found


def table_cells(layer: ObstacleLayer) -> np.ndarray:
    """Return the cells of the table, without those at its edges."""
    return layer.within((TABLE[0] + 0.1, TABLE[1] - 0.1), (TABLE[2] + 0.1, TABLE[3] - 0.1))


def is_closed(cells: np.ndarray) -> bool:
    """Return whether each cell is marked or beside one that is: inflation closes such gaps.

    Up to 7 cm are between scan lines on the table, cells are 5 cm wide.
    """
    return bool(maximum_filter(cells == LETHAL, size=3).all())


def test_the_table_and_the_wall_are_marked_and_the_floor_is_free():
    for layer in states(["obstacles", "floor"])[1:WITH_TABLE]:
        assert is_closed(table_cells(layer))
        assert (layer.within((2.9, 3.2), (-1.0, 1.0)) == LETHAL).any(axis=0).mean() > 0.9
        open_floor = layer.within((1.9, 2.7), (-0.5, 0.5))
        assert not (open_floor == LETHAL).any()
        assert (open_floor == FREE).mean() > 0.9


def test_table_is_cleared_once_forgotten_and_the_wall_stays():
    last = states(["obstacles", "floor"])[-1]
    assert (table_cells(last) == FREE).mean() > 0.99
    assert not (table_cells(last) == LETHAL).any()
    assert (last.within((2.9, 3.2), (-1.0, 1.0)) == LETHAL).any(axis=0).mean() > 0.9


def test_without_the_clearing_source_the_mark_of_the_table_stays():
    assert is_closed(table_cells(states(["obstacles"])[-1]))


def test_marking_and_clearing_have_one_topic_and_rays_exceed_marks():
    marking, clearing = written_sources().values()
    assert marking["topic"] == clearing["topic"] == "/tccm/obstacles"
    assert (marking["marking"], marking["clearing"]) == (True, False)
    assert (clearing["marking"], clearing["clearing"]) == (False, True)
    assert clearing["raytrace_max_range"] > marking["obstacle_max_range"] == pytest.approx(4.0)
