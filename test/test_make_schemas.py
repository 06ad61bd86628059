"""JSON Schema of the result files: it is that of the models, and written files are valid."""

import json
from pathlib import Path

import jsonschema
import pytest
from make_schemas import FILES, file_schema, write_schemas
from result_folder import write_folder

ROOT = Path(__file__).resolve().parents[1]
COMMITTED = ROOT / "docs" / "reference" / "schema"
BAGS = ROOT / "bags"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return write_folder(tmp_path_factory.mktemp("made") / "flat", cycles=3)


def test_the_committed_schemas_are_those_of_the_models(tmp_path):
    write_schemas(tmp_path)
    made = {path.name: path.read_text() for path in tmp_path.iterdir()}
    assert {path.name: path.read_text() for path in COMMITTED.iterdir()} == made, (
        "run make reference"
    )


@pytest.mark.parametrize("name", FILES)
def test_every_schema_is_a_valid_json_schema(name):
    meta = jsonschema.Draft202012Validator(jsonschema.Draft202012Validator.META_SCHEMA)
    assert list(meta.iter_errors(file_schema(name))) == []


@pytest.mark.parametrize("name", [name for name in FILES if name != "truth.json"])
def test_a_missing_key_or_one_of_another_type_is_invalid(folder, name):
    """Every key that is written is required and has its type."""
    tree, schema = json.loads((folder / name).read_text()), file_schema(name)
    jsonschema.validate(tree, schema)
    for key, value in tree.items():
        for wrong in ({k: v for k, v in tree.items() if k != key}, {**tree, key: {"a": [value]}}):
            if key == "config" and key in wrong:
                continue  # any object is a configuration
            with pytest.raises(jsonschema.ValidationError):
                jsonschema.validate(wrong, schema)


@pytest.mark.parametrize("bag", ["flat", "rgbd_kitchen", "upside_down", "walkthrough"])
def test_the_truth_files_of_the_bundled_bags_are_valid(bag):
    truth = json.loads((BAGS / bag / "truth.json").read_text())
    jsonschema.validate(truth, file_schema("truth.json"))
    del truth["surfaces"][0]["height"]
    with pytest.raises(jsonschema.ValidationError, match="height"):
        jsonschema.validate(truth, file_schema("truth.json"))
