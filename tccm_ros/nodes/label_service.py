"""~/set_label of slam_node: corrects the label of a surface."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from rclpy.task import Future

from tccm_ros.errors import TccmError, one_line
from tccm_ros.nodes.interfaces import service_class
from tccm_ros.nodes.surface_services import SurfaceServices
from tccm_ros.records import LabelCorrection
from tccm_ros.surfaces.corrected_labels import label_to_give


def offer_labels(
    node: Node, surfaces: SurfaceServices, correct: Callable[[LabelCorrection], Future]
) -> None:
    """Create ~/set_label.

    Parameters
    ----------
    node
        Node of the service.
    surfaces
        Finds surfaces of the newest solution.
    correct
        Queues the correction of a label.
    """

    async def set_label(request: Any, response: Any) -> Any:
        try:
            surface = surfaces.surface(request.surface_id)
            if request.label:
                label_to_give(request.label)
            ids = (surface.id, *surface.merged_ids)
            await correct(LabelCorrection(ids, request.label))
            response.message = f"surface {surface.id} was '{surface.label}'"
            response.success = True
        except TccmError as error:
            response.success, response.message = False, one_line(error)
        return response

    node.create_service(service_class("SetLabel"), "~/set_label", set_label)
