"""The record of a recording and the reason of a failure are read as they were written."""

from tccm_ros.config import Config
from tccm_ros.fleet.layout import RECORD
from tccm_ros.fleet.record import DoneRecord, Failure, settings_checksum, software_checksum
from tccm_ros.results.folder_reader import read_json_or_none
from tccm_ros.results.numbers import write_json


def test_a_failure_is_read_as_it_was_written(tmp_path):
    failure = Failure("s3://bucket/run.mcap", "no such topic: /scan")
    path = tmp_path / "failures" / "run.json"
    write_json(path, failure)
    assert read_json_or_none(path, Failure) == failure


def test_missing_or_damaged_record_is_none(tmp_path):
    assert read_json_or_none(tmp_path / RECORD, DoneRecord) is None
    (tmp_path / RECORD).write_text('{"source": "x"')
    assert read_json_or_none(tmp_path / RECORD, DoneRecord) is None
    assert read_json_or_none(tmp_path / "none.json", Failure) is None


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
