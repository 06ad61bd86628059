"""JSON Schema of the result files: what is committed is what is made, and what is written fits."""

import json
from pathlib import Path

import jsonschema
import pytest
from result_folder import write_folder

from tccm_ros.results.schema import FILES, file_schema, write_schemas

ROOT = Path(__file__).resolve().parents[2]
COMMITTED = ROOT / "docs" / "reference" / "schema"
BAGS = ROOT / "bags"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return write_folder(tmp_path_factory.mktemp("made") / "flat", cycles=3)


def test_what_is_committed_is_what_is_made(tmp_path):
    write_schemas(tmp_path)
    made = {path.name: path.read_text() for path in tmp_path.iterdir()}
    assert {path.name: path.read_text() for path in COMMITTED.iterdir()} == made, (
        "run make reference"
    )


@pytest.mark.parametrize("name", FILES)
def test_schemas_are_schemas(name):
    jsonschema.Draft202012Validator.check_schema(file_schema(name))


@pytest.mark.parametrize("name", [name for name in FILES if name != "truth.json"])
def test_a_key_that_is_missing_or_of_another_type_does_not_fit(folder, name):
    """Every key that is written is required and has its type."""
    tree, schema = json.loads((folder / name).read_text()), file_schema(name)
    jsonschema.validate(tree, schema)
    for key, value in tree.items():
        for wrong in ({k: v for k, v in tree.items() if k != key}, {**tree, key: {"a": [value]}}):
            if key == "config" and key in wrong:
                continue  # any object is a configuration
            with pytest.raises(jsonschema.ValidationError):
                jsonschema.validate(wrong, schema)


@pytest.mark.parametrize("bag", ["flat", "upside_down", "walkthrough"])
def test_the_truth_of_the_bundled_bags_fits(bag):
    truth = json.loads((BAGS / bag / "truth.json").read_text())
    jsonschema.validate(truth, file_schema("truth.json"))
    del truth["surfaces"][0]["height"]
    with pytest.raises(jsonschema.ValidationError, match="height"):
        jsonschema.validate(truth, file_schema("truth.json"))
