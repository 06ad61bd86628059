"""The package of typed messages, where it is and where it is not."""

import sys

import pytest

from tccm_ros.nodes import interfaces
from tccm_ros.nodes.interfaces import has_interfaces, service_class


@pytest.mark.parametrize("module", ["tccm_interfaces.msg", "tccm_interfaces.srv"])
def test_without_one_half_of_the_package_there_is_none(monkeypatch, module):
    monkeypatch.setitem(sys.modules, module, None)
    assert not has_interfaces()


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
