"""A processor fed with records, without topics."""

from tccm_ros.config import Config
from tccm_ros.mapping.surface_slam import SurfaceSlam
from tccm_ros.mapping.tccm import TccmProcessor
from tccm_ros.records import JointSample, Odometry, RobotDescription, Scan, TransformSample
from tccm_ros.robot import Robot
from tccm_ros.sensors.registry import default_streams


def role_of(record, scans="tilt_scan"):
    """Return the role of a record; `scans` is the role of scans."""
    if isinstance(record, TransformSample):
        return "tf_static" if record.is_static else "tf"
    return {
        Scan: scans, JointSample: "joint_states", Odometry: "odom",
        RobotDescription: "robot_description",
    }[type(record)]  # fmt: skip


class Fed:
    """A processor with its own intake.

    Attributes
    ----------
    robot, processor
        The intake of records, and the processor of its events.
    """

    def __init__(self, processor, scans, **options):
        self.robot = Robot(processor.config, default_streams(), **options)
        self.processor = processor
        self.scans = scans

    @property
    def dropped(self):
        return self.robot.dropped + getattr(self.processor, "dropped", type(self.robot.dropped)())

    def add(self, record):
        """Add one record; return the results of the processor for its events."""
        return self._take(self.robot.add(role_of(record, self.scans), record))

    def finish(self):
        """End the input; return the last results."""
        last = self._take(self.robot.flush())
        return last + (self.processor.finish() if hasattr(self.processor, "finish") else [])

    def _take(self, events):
        return [result for event in events for result in self.processor.add(event)]


def fed_tccm(config=None, **options) -> Fed:
    """Return a TCCM processor that is fed with records; scans are of the tilting laser."""
    return Fed(TccmProcessor(config or Config()), "tilt_scan", **options)


def fed_slam(config=None, **options) -> Fed:
    """Return a SLAM processor that is fed with records; scans are of the level laser."""
    return Fed(SurfaceSlam(config or Config()), "scan", **options)
