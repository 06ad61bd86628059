"""Messages that cannot be used: counted, logged, and reported as a problem of their input."""

from __future__ import annotations

import re
import threading
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

from tccm_ros.errors import one_line
from tccm_ros.nodes.intake.inputs import Blocking

WINDOW_S = 10.0
"""Age up to which refusals set the level of an input: ten messages of /diagnostics. Chosen."""

REPEAT_S = 60.0
"""Period of the log message for a persistent refusal, s. Chosen."""

NUMBER = re.compile(r"\d+(\.\d+)?")


def kind_of(text: str) -> str:
    """Return a sentence with its numbers masked, which is equal for equal problems."""
    return NUMBER.sub("#", text)


@dataclass(slots=True)
class _Kind:
    """The refusals of one kind: newest sentence, its time, and the last log message."""

    sentence: str
    newest_s: float
    said_s: float
    unsaid: int = 0


class Refusals:
    """Refused messages by topic and kind.

    Parameters
    ----------
    say
        Called with a line at the first refusal of a kind, then once a minute while it persists.
    now
        A monotonic clock, s.

    Attributes
    ----------
    counts
        Number of refusals since the start, by topic.
    """

    def __init__(self, say: Callable[[str], object], now: Callable[[], float] = time.monotonic):
        self._say, self._now = say, now
        self._lock = threading.Lock()
        self._kinds: dict[str, dict[str, _Kind]] = {}
        self._used_s: dict[str, float] = {}
        self.counts: Counter[str] = Counter()

    def note(self, topic: str, error: Exception) -> None:
        """Count a message that cannot be used, and log the reason."""
        sentence, now_s = one_line(error), self._now()
        with self._lock:
            self.counts[topic] += 1
            kinds = self._kinds.setdefault(topic, {})
            kind = kinds.get(kind_of(sentence))
            if kind is None:
                kinds[kind_of(sentence)] = _Kind(sentence, now_s, now_s)
                line = f"{topic}: {sentence}"
            else:
                kind.sentence, kind.newest_s, kind.unsaid = sentence, now_s, kind.unsaid + 1
                if now_s - kind.said_s < REPEAT_S:
                    return
                line = f"{topic}: {kind.unsaid} more refused: {sentence}"
                kind.said_s, kind.unsaid = now_s, 0
        self._say(line)

    def note_used(self, topic: str) -> None:
        """Note that a message of a topic was used."""
        self._used_s[topic] = self._now()

    def problem(self, topic: str) -> str | None:
        """Return the recent refusals of a topic; `Blocking` if none of its messages was used."""
        since_s = self._now() - WINDOW_S
        with self._lock:
            kinds = self._kinds.get(topic, {}).values()
            newest = sorted(kind.sentence for kind in kinds if kind.newest_s >= since_s)
        if not newest:
            return None
        is_used = self._used_s.get(topic, since_s - 1.0) >= since_s
        text = f"{'some' if is_used else 'all'} messages of '{topic}' are refused: "
        text += "; ".join(newest)
        return text if is_used else Blocking(text)

    def problems(self) -> list[str]:
        """Return the problems of all topics."""
        with self._lock:
            topics = sorted(self._kinds)
        return [text for text in map(self.problem, topics) if text]
