"""Without the libraries of the extra, the command says what to install."""

import pytest

from tccm_ros.errors import FleetError
from tccm_ros.fleet import extra


def test_all_libraries_are_found():
    extra.check_installed()


def test_a_library_that_is_missing_is_named_with_what_to_install(monkeypatch):
    monkeypatch.setattr(extra, "LIBRARIES", ("distributed", "no_such_library"))
    with pytest.raises(FleetError, match=r"^no_such_library not installed.*tccm_ros\[fleet\]"):
        extra.check_installed()
