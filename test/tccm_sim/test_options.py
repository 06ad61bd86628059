"""Options of a simulation from ``key=value`` settings."""

import logging

import pytest

from tccm_ros.errors import ConfigError
from tccm_sim.options import RENAMED, Options, options_from_settings


@pytest.mark.parametrize(("before", "now"), RENAMED.items())
def test_an_option_is_read_by_its_name_of_release_0_1_with_a_warning(before, now, caplog):
    text = "-0.5,0.5" if now == "tilt_limits" else "2.5"
    with caplog.at_level(logging.WARNING):
        options = options_from_settings({before: text})
    assert options == options_from_settings({now: text})
    assert options != Options()
    assert f"'{now}'" in caplog.text


def test_an_option_that_does_not_exist_names_the_nearest():
    with pytest.raises(ConfigError, match="cycle_period"):
        options_from_settings({"cycle_perod": "2"})
