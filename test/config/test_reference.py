"""The shipped YAML file against the configuration that it is made from."""

from pathlib import Path

from tccm_ros.config import Config
from tccm_ros.config.reader import read_config
from tccm_ros.config.reference import as_yaml

ROOT = Path(__file__).resolve().parents[2]


def test_the_shipped_yaml_is_made_from_the_configuration():
    assert (ROOT / "config" / "tccm.yaml").read_text() == as_yaml(), "run make reference"


def test_the_shipped_yaml_reads_as_the_defaults():
    assert read_config(ROOT / "config" / "tccm.yaml") == Config()
