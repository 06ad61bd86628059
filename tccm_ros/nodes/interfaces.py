"""Availability of tccm_interfaces in this version, and services of its types."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from importlib import import_module
from inspect import iscoroutinefunction
from typing import Any

from rclpy.node import Node

from tccm_ros.bags.typestore import DEFINITIONS, TypestoreMessages
from tccm_ros.errors import TccmError, one_line

MISSING = (
    "tccm_interfaces is not installed: no typed messages, events and questions; build it "
    "(interfaces/README.md) and source the workspace"
)
"""Message on /diagnostics without the package."""

OLD = (
    "tccm_interfaces is of another version ({name} has other fields): no typed messages, events "
    "and questions; build it again (interfaces/README.md) and source the workspace"
)


def missing_interfaces() -> str:
    """Return why the package cannot be used, as a sentence; empty if it can."""
    try:
        installed = import_module("tccm_interfaces.msg")
        import_module("tccm_interfaces.srv")
    except ImportError:
        return MISSING
    return _difference(installed)


@cache
def _difference(installed: Any) -> str:
    """Return a sentence with the first message that has other fields; empty if there is none."""
    types = TypestoreMessages()
    for path in sorted(DEFINITIONS.glob("*.msg")):
        kind = getattr(installed, path.stem, None)
        expected = types.field_names(f"tccm_interfaces/msg/{path.stem}")
        if kind is None or list(kind.get_fields_and_field_types()) != expected:
            return OLD.format(name=path.stem)
    return ""


def has_interfaces() -> bool:
    """Return whether the package can be used."""
    return not missing_interfaces()


def service_class(name: str) -> Any:
    """Return the class of a service such as ``FindSurfaces``."""
    return getattr(import_module("tccm_interfaces.srv"), name)


@contextmanager
def _errors_in_response(response: Any) -> Iterator[None]:
    """Set a response's success, and the message of an error."""
    try:
        yield
        response.success = True
    except (TccmError, OSError) as error:
        response.success, response.message = False, one_line(error)


def offer_service(
    node: Node, kind: str, name: str, answer: Callable[[Any, Any], Any], **options: Any
) -> None:
    """Create a service whose response has the fields `success` and `message`.

    Parameters
    ----------
    node
        Node of the service.
    kind, name
        Its type, such as ``FindSurfaces``, and its name.
    answer
        Function or coroutine that fills the response to a request and returns its message; a
        TccmError or OSError becomes the message of a failure.
    options
        Further arguments of `Node.create_service`.
    """

    def call(request: Any, response: Any) -> Any:
        with _errors_in_response(response):
            response.message = answer(request, response)
        return response

    async def await_answer(request: Any, response: Any) -> Any:
        with _errors_in_response(response):
            response.message = await answer(request, response)
        return response

    callback = await_answer if iscoroutinefunction(answer) else call
    node.create_service(service_class(kind), name, callback, **options)
