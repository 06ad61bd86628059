"""The record of a recording and the reason of a failure are read as they were written."""

from tccm_ros.config import Config
from tccm_ros.fleet.record import (
    Failure,
    read_failure,
    read_record,
    settings_checksum,
    software_checksum,
)


def test_a_failure_is_read_as_it_was_written(tmp_path):
    failure = Failure("s3://bucket/run.mcap", "no such topic: /scan")
    failure.write(tmp_path / "failures" / "run.json")
    assert read_failure(tmp_path / "failures" / "run.json") == failure


def test_what_is_missing_or_damaged_is_none(tmp_path):
    assert read_record(tmp_path) is None
    (tmp_path / "fleet.json").write_text('{"source": "x"')
    assert read_record(tmp_path) is None
    assert read_failure(tmp_path / "none.json") is None


def test_a_checksum_of_settings_is_of_every_value():
    other = Config.model_validate({"surfaces": {"min_area": 0.2}})
    checksums = {
        settings_checksum(Config()),
        settings_checksum(other),
        settings_checksum(Config(), remap=("scan:=/base_scan",)),
    }
    assert len(checksums) == 3
    assert settings_checksum(Config()) == settings_checksum(Config())


def test_the_checksum_of_the_software_is_one():
    assert software_checksum() == software_checksum()
    assert len(software_checksum()) == 64
