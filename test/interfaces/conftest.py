"""The fixtures of tests over DDS."""

from ros_harness import domain, ros

__all__ = ["domain", "ros"]
