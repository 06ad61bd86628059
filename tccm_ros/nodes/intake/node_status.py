"""State of a sensor node for /diagnostics: its inputs, drops and figures."""

from __future__ import annotations

import statistics
from collections import Counter
from collections.abc import Mapping

from tccm_ros.config import Config
from tccm_ros.nodes.intake.diagnostics import InputStatus
from tccm_ros.nodes.intake.drops import DropWatch
from tccm_ros.nodes.intake.inputs import Input, Inputs
from tccm_ros.nodes.intake.refusals import Refusals


class NodeStatus:
    """Problems and figures of the inputs of a node.

    Parameters
    ----------
    config
        Parameters of the node.
    inputs, refusals
        Where messages are counted.
    """

    def __init__(self, config: Config, inputs: Inputs, refusals: Refusals):
        self._config, self._inputs, self._refusals = config, inputs, refusals
        self._drops = DropWatch()

    def problems_of_inputs(self) -> list[str]:
        """Return one line for each input that is silent, unusable or late."""
        return [*self._inputs.problems(), *self._lagging().values()]

    def problems_of_drops(self, dropped: Counter[str]) -> list[str]:
        """Return one line for each reason by which more scans were dropped than before."""
        return self._drops.problems(dropped)

    def input_states(self, used: Mapping[str, int]) -> list[InputStatus]:
        """Return the state of each input.

        Parameters
        ----------
        used
            Records that the processor has used, by resolved topic; by default all that were read.
        """
        late = self._lagging()
        return [self._state(entry, used, late) for entry in self._inputs]

    def values(self, dropped: Counter[str]) -> dict[str, object]:
        """Return the counts of messages, by topic and by reason of a drop."""
        received = {f"received {topic}": n for topic, n in self._inputs.counts().items()}
        lost = {f"lost {topic}": n for topic, n in self._inputs.lost().items()}
        refused = {f"refused {topic}": n for topic, n in sorted(self._refusals.counts.items())}
        reasons = {f"dropped: {why}": n for why, n in sorted(dropped.items())}
        return {**received, **lost, **refused, **reasons}

    def _state(self, entry: Input, used: Mapping[str, int], late: Mapping[str, str]) -> InputStatus:
        received, latency_s = entry.count, entry.latency_s
        values: dict[str, object] = {
            "needed": entry.watch,
            "expected": received + entry.lost,
            "received": received,
            "used": min(used.get(entry.topic, received - entry.refused), received),
            "latency [s]": "" if latency_s is None else f"{latency_s:.3f}",
        }
        problems = (
            self._refusals.problem(entry.name),
            self._inputs.problem(entry),
            late.get(entry.topic),
        )
        return InputStatus(entry.topic, tuple(text for text in problems if text), values)

    def _lagging(self) -> dict[str, str]:
        """Return a sentence for each input that lags behind the others, by topic."""
        if self._config.qos.stamp == "receive":
            return {}
        return lagging(self._inputs.latencies(), self._config.sync_timeout)


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
