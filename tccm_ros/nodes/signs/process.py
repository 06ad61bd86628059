"""The process that reads door signs: `python -m tccm_ros.nodes.signs.process DESCRIPTOR`.

It receives posed pictures one after another and answers each with the signs found. It ignores stop
signals, which are for the node, and ends with the node.
"""

from __future__ import annotations

import sys
from multiprocessing.connection import Connection

from tccm_ros.config import Config
from tccm_ros.errors import one_line
from tccm_ros.nodes.process.child_process import yield_to_node
from tccm_ros.signs.processor import SignProcessor


def answer_pictures(connection: Connection) -> None:
    """Answer each picture received after the configuration, until the connection is closed.

    An answer is a pair: the results of the picture, and the reason why it could not be read, empty
    if it could.
    """
    processor = SignProcessor(Config.model_validate_json(connection.recv()))
    while True:
        try:
            posed = connection.recv()
        except (EOFError, OSError):
            return
        try:
            answer = tuple(processor.read(posed)), processor.problem
        except Exception as error:
            answer = (), f"{type(error).__name__}: {one_line(error)}"
        connection.send(answer)


def main() -> None:
    """Serve the node at the other end of the pipe whose descriptor is the first argument."""
    yield_to_node()
    answer_pictures(Connection(int(sys.argv[1])))


if __name__ == "__main__":
    main()
