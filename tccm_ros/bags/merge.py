"""Read several storage files as one, in log order."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from heapq import heappop, heappush

from tccm_ros.bags.bag_files import StorageFile
from tccm_ros.bags.storage import Channel, RawMessage

__all__ = ["Source", "merge"]

Source = tuple[StorageFile, dict[int, Channel]]
"""A file and the channels that are wanted of it."""


def merge(
    sources: Sequence[Source],
) -> Iterator[tuple[StorageFile, dict[int, Channel], RawMessage]]:
    """Merge files in log order; a file is begun when its first message is due.

    Files are sorted by start, so that a recording in a thousand splits has one of them in memory.
    """
    waiting = list(sources)[::-1]
    active: list[tuple[int, int, RawMessage, Iterator[RawMessage]]] = []
    begun: list[Source] = []
    while waiting or active:
        while waiting and (not active or waiting[-1][0].start_ns <= active[0][0]):
            file, channels = waiting.pop()
            begun.append((file, channels))
            _advance(active, len(begun) - 1, file.messages(channels))
        if len(active) == 1 and not waiting:
            _, index, message, rest = active.pop()
            yield (*begun[index], message)
            yield from ((*begun[index], message) for message in rest)
        elif active:
            _, index, message, rest = heappop(active)
            yield (*begun[index], message)
            _advance(active, index, rest)


def _advance(
    active: list[tuple[int, int, RawMessage, Iterator[RawMessage]]],
    index: int,
    messages: Iterator[RawMessage],
) -> None:
    message = next(messages, None)
    if message is not None:
        heappush(active, (message.log_ns, index, message, messages))
