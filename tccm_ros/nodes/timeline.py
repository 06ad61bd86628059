"""Bag time during playback, with rate, start, pause and loops, independent of the ROS clock."""

from __future__ import annotations


class Timeline:
    """Maps the time of a player to the time of its bag.

    Parameters
    ----------
    bag_ns
        Bag time at which playing starts.
    rate
        Seconds of the bag per second; > 0.
    is_paused
        Whether playing starts paused.

    Notes
    -----
    The player's time is any monotonic clock, ns.
    """

    def __init__(self, bag_ns: int, rate: float, *, is_paused: bool = False):
        self._bag_ns = bag_ns
        self._rate = rate
        self._since_ns: int | None = None
        self.is_paused = is_paused

    @property
    def is_running(self) -> bool:
        """Whether the bag time advances."""
        return self._since_ns is not None and not self.is_paused

    def now(self, clock_ns: int) -> int:
        """Return the bag time at a time of the player's clock, ns."""
        if self.is_paused or self._since_ns is None:
            return self._bag_ns
        return self._bag_ns + round((clock_ns - self._since_ns) * self._rate)

    def run(self, clock_ns: int) -> None:
        """Start, or continue after a pause."""
        self._since_ns = clock_ns
        self.is_paused = False

    def pause(self, clock_ns: int) -> None:
        """Stop the bag time."""
        self._bag_ns = self.now(clock_ns)
        self.is_paused = True

    def rewind(self, bag_ns: int, clock_ns: int) -> None:
        """Set the bag time."""
        self._bag_ns = bag_ns
        self._since_ns = None if self._since_ns is None else clock_ns
