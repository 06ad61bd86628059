"""Scans with their poses, in stamp order, however the topics interleave.

A scan is given as soon as odometry and all joints between base and laser bracket it; samples
further apart than half of `sync_timeout` do not. Until then it waits in message time: at least
`sync_timeout`, and longer only while what it waits for is late but still comes. What cannot be
posed is dropped whole and counted by reason; nothing is extrapolated. So topics may arrive
`sync_timeout / 2` apart, and it does not show in what is given.
"""

from tccm_ros.sync.synchroniser import MAX_WAITING, Synchroniser, SyncRecord

__all__ = ["MAX_WAITING", "SyncRecord", "Synchroniser"]
