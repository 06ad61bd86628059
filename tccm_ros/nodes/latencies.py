"""Detection of inputs that lag behind the others."""

from __future__ import annotations

import statistics
from collections.abc import Mapping


def lagging(latencies_s: Mapping[str, float], limit_s: float) -> dict[str, str]:
    """Return a problem for each input that lags, by topic.

    An input is compared with the median of the others (the higher one of two), so that a single
    early input makes none of the others late.

    Parameters
    ----------
    latencies_s
        Latency from stamp to arrival, s, by topic.
    limit_s
        Tolerated lag, s: `sync_timeout`, for which records wait for each other.
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
