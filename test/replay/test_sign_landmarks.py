"""Door signs of the bundled office, from rendered pictures to landmarks."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi2

from tccm_ros.results.folder_reader import read_json
from tccm_ros.results.models import GraphFile, SignsFile, WallsFile

BAG = Path(__file__).resolve().parents[2] / "bags" / "office_signs"
MAX_ERROR = 0.05
"""Of the position of a sign, m: the target."""


@pytest.fixture(scope="module")
def folder(session_files):
    pytest.importorskip("onnxruntime", reason="the extra 'signs' is not installed")
    return session_files.replayed("office_signs")


@pytest.fixture(scope="module")
def truth():
    signs = json.loads((BAG / "truth.json").read_text())["signs"]
    return {sign["text"]: sign for sign in signs}


def test_the_door_signs_of_the_office_are_where_they_are(folder, truth):
    signs = {s.number: s for s in read_json(folder / "signs.json", SignsFile).signs}
    assert len(signs.keys() & truth.keys()) >= 9
    assert signs.keys() <= truth.keys()
    total = 0.0
    for number in signs.keys() & truth.keys():
        sign, true = signs[number], truth[number]
        error = sign.position - true["position"]
        assert np.linalg.norm(error) < MAX_ERROR, number
        assert sign.normal @ true["normal"] > 0.99
        assert sign.wall is not None
        total += error @ np.linalg.solve(sign.covariance, error)
    assert total < chi2.ppf(0.999, 3 * len(truth))


def test_signs_of_a_replay_are_landmarks_on_walls_that_the_files_have(folder):
    signs = read_json(folder / "signs.json", SignsFile).signs
    walls = {wall.id for wall in read_json(folder / "walls.json", WallsFile).walls}
    graph = read_json(folder / "graph.json", GraphFile)
    assert {s.wall for s in signs} <= walls | {None}
    assert [m.id for m in graph.landmarks if m.kind == "sign"] == [s.id for s in signs]
    keyframes = {k.id for k in graph.keyframes}
    assert all(view.keyframe in keyframes for sign in signs for view in sign.views)
