"""Process recorded bags with the processors of the live nodes, and show the results."""

from tccm_ros.pipeline.outcome import Outcome
from tccm_ros.pipeline.processors import Pipeline
from tccm_ros.pipeline.run import run_bag

__all__ = ["Outcome", "Pipeline", "run_bag"]
