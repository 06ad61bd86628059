"""Inputs that lag behind the others."""

from __future__ import annotations

import statistics
from collections.abc import Mapping


def lagging(latencies_s: Mapping[str, float], limit_s: float) -> dict[str, str]:
    """Return what is wrong with inputs that lag, by topic.

    An input is compared with the median of the others, the later one of two: one that is ahead of
    all others makes none of them late.

    Parameters
    ----------
    latencies_s
        From stamp to arrival, s, by topic.
    limit_s
        Lags up to this are none: `sync_timeout`, for which records wait for each other.
    """
    found = {}
    for topic, latency_s in latencies_s.items():
        others = [s for name, s in latencies_s.items() if name != topic]
        if not others:
            continue
        usual_s = statistics.median_high(others)
        if latency_s - usual_s > limit_s:
            found[topic] = (
                f"'{topic}' comes {latency_s - usual_s:.1f} s later than the other inputs "
                f"({latency_s:.2f} s from stamp to arrival, the others {usual_s:.2f} s): look at "
                "its driver's queue and the network, or set the clock that stamps it; what it "
                "measures is used late or dropped, and poses and heights suffer"
            )
    return found
