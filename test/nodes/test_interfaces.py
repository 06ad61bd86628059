"""The package of typed messages, where it is and where it is not."""

import sys
from importlib import import_module
from types import ModuleType, SimpleNamespace

import pytest

from tccm_ros.nodes import interfaces
from tccm_ros.nodes.interfaces import has_interfaces, missing_interfaces, service_class


@pytest.mark.parametrize("module", ["tccm_interfaces.msg", "tccm_interfaces.srv"])
def test_incomplete_interface_package_counts_as_missing(monkeypatch, module):
    monkeypatch.setitem(sys.modules, module, None)
    assert not has_interfaces()


@pytest.mark.skipif(not has_interfaces(), reason="tccm_interfaces is not installed")
@pytest.mark.parametrize("kept", [None, slice(0, -1)])
def test_a_package_of_another_version_is_not_used_and_is_named(monkeypatch, kept):
    """A message is not there, or has a field less: bytes of ours could not be read with it."""
    installed = import_module("tccm_interfaces.msg")
    names = list(installed.Surface.get_fields_and_field_types())
    fields = None if kept is None else dict.fromkeys(names[kept])
    old = ModuleType("tccm_interfaces.msg")
    vars(old).update(vars(installed))
    old.Surface = SimpleNamespace(get_fields_and_field_types=lambda: fields) if fields else None
    monkeypatch.setitem(sys.modules, "tccm_interfaces.msg", old)
    assert not has_interfaces()
    assert "another version (Surface has other fields)" in missing_interfaces()


def test_another_error_in_the_package_is_not_hidden(monkeypatch):
    def broken(name):
        raise RuntimeError(name)

    monkeypatch.setattr(interfaces, "import_module", broken)
    with pytest.raises(RuntimeError, match=r"tccm_interfaces\.msg"):
        has_interfaces()


@pytest.mark.skipif(not has_interfaces(), reason="tccm_interfaces is not installed")
def test_a_service_is_found_by_its_name():
    request = service_class("SaveMap").Request()
    assert (request.name, request.overwrite) == ("", False)
    with pytest.raises(AttributeError):
        service_class("NoSuchService")
