"""Browsers on the live page while nodes map: processor time, memory, bytes, dropped scans.

Usage: python bench/bench_live_page.py [--bag bags/flat] [--clients 10] [--seconds 300]

Plays a bag, slowed down to the wanted time, into tccm_node and slam_node as processes; view_node is
a third one. Each client reads the events of the page as a browser does. Prints a table; asserts
nothing.
"""

from __future__ import annotations

import argparse
import http.client
import os
import signal
import socket
import threading
import time
from pathlib import Path

import rclpy
from soak_nodes import NODES, Watch, duration, resident_mb, start

ROOT = Path(__file__).resolve().parents[1]


class Client(threading.Thread):
    """Reads the events of a page; counts the bytes of the first picture and those after it."""

    def __init__(self, port: int):
        super().__init__(daemon=True)
        self.first = self.later = 0
        self._connection = http.client.HTTPConnection("127.0.0.1", port, timeout=600)
        self.start()

    def run(self) -> None:
        """Read until the page ends."""
        self._connection.request("GET", "/events")
        stream = self._connection.getresponse()
        while line := stream.readline():
            if self.first:
                self.later += len(line)
            elif line.startswith(b"data: "):
                self.first = len(line)


def free_port() -> int:
    """Return a port that nobody listens at."""
    with socket.create_server(("127.0.0.1", 0)) as found:
        return int(found.getsockname()[1])


def processor_s(pid: int) -> float:
    """Return the processor time of a process so far, s."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def run(bag: Path, clients: int, seconds: float) -> None:
    """Play the bag, and print what the clients cost."""
    rclpy.init()
    watch, port = Watch(), free_port()
    reliable = ("-p", "qos.reliability:=reliable")
    processes = {name: start(module, *reliable) for name, module in NODES.items()}
    view = processes["view"] = start("view_node", "-p", f"view.port:={port}")
    try:
        watch.spin_until(lambda: set(NODES) <= set(watch.reports), "the nodes")
        rate = duration(bag) / seconds
        words = f"bag:={bag}", f"rate:={rate}", "reliable:=true", "wait_for_subscribers:=60.0"
        player = start("player_node", *(w for word in words for w in ("-p", word)))
        watch.spin_until(lambda: watch.poses, "the first pose")
        pages = [Client(port) for _ in range(clients)]
        begin, used_s = time.monotonic(), processor_s(view.pid)
        watch.spin_until(lambda: player.poll() is not None, "the end of the bag")
        passed_s, used_s = time.monotonic() - begin, processor_s(view.pid) - used_s
        print(f"{clients} clients, {passed_s:.0f} s of {bag.name}")
        print(
            f"processor time of view_node: {used_s:.1f} s, {100 * used_s / passed_s:.1f} % of one"
        )
        print(f"peak memory of view_node: {resident_mb(view.pid, highest=True):.0f} MB")
        print(f"first picture: {max(page.first for page in pages) / 1e3:.1f} kB")
        print(f"after it: {max(page.later for page in pages) / passed_s / 1e3:.2f} kB/s at most")
        for name in NODES:
            drops = {k: v for k, v in watch.reports[name].items() if k.startswith("dropped")}
            print(f"{name}: {drops or 'no scan dropped'}")
    finally:
        for process in processes.values():
            process.send_signal(signal.SIGINT)
            process.wait()
        rclpy.try_shutdown()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--bag", type=Path, default=ROOT / "bags" / "flat")
    parser.add_argument("--clients", type=int, default=10)
    parser.add_argument("--seconds", type=float, default=300.0)
    arguments = parser.parse_args()
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    os.environ.setdefault("ROS_DOMAIN_ID", "97")
    run(arguments.bag, arguments.clients, arguments.seconds)


if __name__ == "__main__":
    main()
