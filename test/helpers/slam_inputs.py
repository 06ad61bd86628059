"""Inputs of the SLAM processor in a recording."""

from pathlib import Path

from tccm_ros.bags.reader import DEFAULT_TOPICS, BagReader
from tccm_ros.config import Config
from tccm_ros.replay.processors import Pipeline


def slam_inputs(bag: Path) -> list[object]:
    """Return the inputs of the SLAM processor in a replay of a recording, in order."""
    pipeline, inputs = Pipeline(Config(), expects_odometry=True), []
    pipeline.slam.add = inputs.append
    with BagReader(bag) as reader:
        for role, _, record in reader.records(DEFAULT_TOPICS):
            pipeline.add(role, record)
    pipeline.finish()
    return inputs
