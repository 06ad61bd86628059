"""A recorded bag through the processors: the same ones as the live nodes', fed from a file."""

from tccm_ros.pipeline.outcome import Outcome
from tccm_ros.pipeline.processors import Pipeline
from tccm_ros.pipeline.run import run_bag

__all__ = ["Outcome", "Pipeline", "run_bag"]
