"""The files of a saved map as a folder, without a node."""

from tccm_ros.atomic import output_folder
from tccm_ros.nodes.solver.process import map_files


def write_map(folder, processor, solution):
    """Write a solution of a `SurfaceSlam` atomically, as the nodes do."""
    with output_folder(folder) as made:
        files = map_files(processor, solution, "map", processor.saved(solution))
        for name, content in files.items():
            (made / name).write_bytes(content)
