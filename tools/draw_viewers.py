"""Draw docs/images/rerun.png: a recording in Rerun's web viewer, by a headless Chromium.

Usage: python tools/draw_viewers.py FILE.rrd [OUT.png]
"""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from urllib.parse import quote

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "test" / "helpers"))

WEB_PORT, DATA_PORT = 9190, 9976
START_S, DRAW_S = 4.0, 45.0
"""Until the server answers, and until a processor that stands in for the graphics card has drawn
the recording, s; measured, twice as long."""


def draw(recording: Path, out: Path) -> None:
    """Write a picture of the viewer with a recording."""
    from chromium import Browser

    program = Path(sys.executable).parent / "rerun"
    ports = ("--web-viewer-port", str(WEB_PORT), "--port", str(DATA_PORT))
    server = subprocess.Popen([program, recording, "--serve-web", *ports])
    address = quote(f"rerun+http://127.0.0.1:{DATA_PORT}/proxy", safe="")
    try:
        time.sleep(START_S)
        with TemporaryDirectory() as profile, Browser(profile, 1500, 950) as browser:
            page = f"http://127.0.0.1:{WEB_PORT}/?url={address}&renderer=webgl"
            browser.call("Page.navigate", url=page)
            time.sleep(DRAW_S)
            browser.screenshot(out)
    finally:
        server.terminate()
        server.wait()


if __name__ == "__main__":
    given = [Path(text) for text in sys.argv[1:]]
    draw(given[0], given[1] if len(given) > 1 else ROOT / "docs" / "images" / "rerun.png")
