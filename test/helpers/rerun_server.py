"""A Rerun server without a viewer, which writes all that it receives to an .rrd."""

import signal
import socket
import subprocess
import sys
from pathlib import Path

SERVER = Path(sys.executable).parent / "rerun"


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as found:
        return found.getsockname()[1]


class RerunServer:
    """Runs until it is closed; then `store` has its content."""

    def __init__(self, port: int, file: Path):
        self.file = file
        words = ["--save", str(file), "--bind", "127.0.0.1", "--port", str(port)]
        self._process = subprocess.Popen(
            [SERVER, *words], stdout=subprocess.PIPE, stderr=subprocess.STDOUT
        )

    def close(self) -> None:
        self._process.send_signal(signal.SIGINT)
        self._process.communicate(timeout=60)

    def store(self):
        """Return what was received, as chunks."""
        from rerun.chunk import RrdReader

        return RrdReader(self.file).stream().collect()


def rows(store, entity, component, index="stamp"):
    """Return the stamps, s, and values of a component of an entity."""
    table = store.reader(index=index, contents=entity).to_arrow_table()
    [name] = [n for n in table.column_names if n.endswith(component)]
    values = table.column(name).to_pylist()
    if index is None:
        return values
    stamps = table.column(index).cast("int64").to_numpy() * 1e-9
    kept = [k for k, value in enumerate(values) if value is not None]
    return stamps[kept], [values[k] for k in kept]
