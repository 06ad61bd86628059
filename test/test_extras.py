"""What is missing for an extra is named, with the command that installs it."""

import pytest

from tccm_ros.errors import MissingExtraError
from tccm_ros.extras import check_extra


def test_installed_extra_passes():
    assert check_extra("view", "json", "numpy") is None


def test_missing_library_is_named_with_its_extra():
    with pytest.raises(MissingExtraError, match=r"^no_such_module not installed.*tccm_ros\[view\]"):
        check_extra("view", "json", "no_such_module")
