"""The Foxglove layout and the RViz configuration show what the nodes and result.mcap publish."""

import json
from pathlib import Path

import pytest
import yaml

from tccm_ros.config import Config
from tccm_ros.ros.topic_messages import CYCLE_TOPICS, SOLUTION_TOPICS, SURFACE_MESSAGE_TOPICS

CONFIG = Path(__file__).resolve().parents[2] / "config"

PUBLISHED = {f"/tccm/{topic}" for topic in CYCLE_TOPICS}
PUBLISHED |= {f"/surface_slam/{topic}" for topic in SOLUTION_TOPICS}
FOR_PROGRAMS = {"/tccm/object_boxes"}
FOR_PROGRAMS |= {
    f"/surface_slam/{topic}"
    for topic, kind in SOLUTION_TOPICS.items()
    if kind.startswith(("tccm_interfaces", "object_recognition_msgs"))
}
"""Topics that viewers cannot draw: typed messages, and what slam_node takes from tccm_node."""

PUBLISHED -= FOR_PROGRAMS

SENSORS = {
    f"/{topic}" for topic in (*Config().sensors.point_clouds, *Config().sensors.depth_images)
}
"""What depth cameras and 3D lidars publish under their default names."""

LEVEL_SCAN = "/tccm/level_scan"

OTHERS = {"/pose", "/map", "/scan", "/surface_slam/map_to_odom", "/tccm/center_cores", LEVEL_SCAN}
OTHERS |= SENSORS
"""Topics that the nodes or the robot publish besides results (docs/reference/nodes.md)."""

NOT_IN_RVIZ = {"/tccm/view"}
"""Topics with intervals, for which RViz has no display."""


@pytest.fixture(scope="module")
def panels():
    layout = json.loads((CONFIG / "foxglove.json").read_text())
    return layout["configById"]


@pytest.fixture(scope="module")
def displays():
    tree = yaml.safe_load((CONFIG / "tccm.rviz").read_text())
    shown = tree["Visualization Manager"]["Displays"]
    return {d["Topic"]["Value"]: d for d in shown if "Topic" in d}


def test_foxglove_panels_know_every_topic(panels):
    for panel in panels.values():
        assert set(panel["topics"]) >= PUBLISHED
        assert set(panel["topics"]) <= PUBLISHED | OTHERS
        assert panel["followTf"] == "map"


def test_the_foxglove_layout_uses_panels_that_it_defines(panels):
    layout = json.loads((CONFIG / "foxglove.json").read_text())["layout"]
    assert {layout["first"], layout["second"]} == set(panels)


def test_the_main_topics_are_visible_at_first(panels, displays):
    wanted = {
        "/surface_slam/surfaces", "/surface_slam/walls", "/tccm/planes", "/tccm/objects",
        "/tccm/map_cloud", "/pose",
    }  # fmt: skip
    for panel in panels.values():
        assert {t for t, s in panel["topics"].items() if s["visible"]} >= wanted
    assert {t for t, d in displays.items() if d["Enabled"]} >= wanted


def test_rviz_displays_know_every_topic(displays):
    assert set(displays) >= PUBLISHED - NOT_IN_RVIZ
    assert set(displays) <= PUBLISHED | OTHERS


def test_rviz_requests_the_qos_that_publishers_offer(displays):
    """A transient-local subscription does not match a volatile publisher."""
    volatile = {f"/tccm/{topic}" for topic in SURFACE_MESSAGE_TOPICS} | SENSORS
    volatile |= {"/pose", LEVEL_SCAN}
    for topic, display in displays.items():
        latched = display["Topic"]["Durability Policy"] == "Transient Local"
        assert latched == (topic not in volatile), topic


def test_rviz_display_classes_match_the_message_types(displays):
    kinds = {
        "visualization_msgs/msg/MarkerArray": "rviz_default_plugins/MarkerArray",
        "sensor_msgs/msg/PointCloud2": "rviz_default_plugins/PointCloud2",
        "nav_msgs/msg/Path": "rviz_default_plugins/Path",
    }
    types = {f"/tccm/{t}": k for t, k in CYCLE_TOPICS.items()}
    types |= {f"/surface_slam/{t}": k for t, k in SOLUTION_TOPICS.items()}
    for topic in set(displays) & set(types):
        assert displays[topic]["Class"] == kinds[types[topic]], topic


def test_depth_cameras_and_lidars_are_shown_beside_the_laser(panels, displays):
    for panel in panels.values():
        assert set(panel["topics"]) >= SENSORS | {LEVEL_SCAN}
    assert set(displays) >= SENSORS | {LEVEL_SCAN}
    kinds = {"/points": "PointCloud2", "/depth/image_rect_raw": "Image", LEVEL_SCAN: "LaserScan"}
    for topic, kind in kinds.items():
        assert displays[topic]["Class"] == f"rviz_default_plugins/{kind}"
    for topic in SENSORS:  # what a reliable subscription asks for, a sensor's QoS does not offer
        assert displays[topic]["Topic"]["Reliability Policy"] == "Best Effort"
