"""Reader of maps like nav2_map_server."""

import numpy as np
import yaml


def as_map_server_reads(path):
    """Return a map, read by the rules of nav2_map_server's trinary mode."""
    about = yaml.safe_load(path.read_text())
    kind, size, depth, data = (path.parent / about["image"]).read_bytes().split(b"\n", 3)
    width, height = map(int, size.split())
    assert (kind, depth, about["mode"]) == (b"P5", b"255", "trinary")
    shades = np.frombuffer(data, np.uint8).reshape(height, width)[::-1] / 255.0
    occupied = shades if about["negate"] else 1.0 - shades
    cells = np.full(shades.shape, -1, np.int8)
    cells[occupied > about["occupied_thresh"]] = 100
    cells[occupied < about["free_thresh"]] = 0
    return cells, about["resolution"], about["origin"]
