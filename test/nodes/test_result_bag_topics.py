"""result.mcap has the topics of the live nodes, with their types."""

import pytest
from live_robot import slam, tccm
from mcap.reader import make_reader

from tccm_ros.bags.writer import BagWriter
from tccm_ros.config import Config
from tccm_ros.nodes.interfaces import has_interfaces
from tccm_ros.results.result_bag import CycleMessageStore, ResultBag

pytestmark = pytest.mark.skipif(not has_interfaces(), reason="tccm_interfaces is not installed")

OF_THE_MOMENT = {"/diagnostics", "/parameter_events", "/rosout"}
"""How a node does, not what it has found."""

FOR_PLANNERS = {"/planning_scene", "/surface_slam/keepout_info", "/surface_slam/keepout_mask"}
"""Other forms of the surfaces and objects, for planners that run."""


def test_the_bag_has_the_topics_of_both_nodes(ros, tmp_path):
    nodes = tccm(ros), slam(ros)
    live = {
        topic: kinds[0]
        for node in nodes
        for topic, kinds in node.get_publisher_names_and_types_by_node(node.get_name(), "/")
        if topic not in OF_THE_MOMENT | FOR_PLANNERS and "/_action/" not in topic
    }
    config = Config()
    messages = CycleMessageStore(config, tmp_path)
    with BagWriter(tmp_path / "result.mcap", typestore=messages.types) as bag:
        ResultBag(bag, messages, config)
    with (tmp_path / "result.mcap").open("rb") as file:
        summary = make_reader(file).get_summary()
    written = {c.topic: summary.schemas[c.schema_id].name for c in summary.channels.values()}
    assert live == written
