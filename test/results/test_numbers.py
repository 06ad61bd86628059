import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from tccm_ros.results.numbers import json_text, rounded, rounded_list

anything = st.floats(width=64) | st.integers(-(10**9), 10**9).map(lambda k: (k + 0.5) * 1e-6)


@settings(max_examples=400, deadline=None)
@given(hnp.arrays(np.float64, hnp.array_shapes(max_dims=2, max_side=5), elements=anything))
def test_an_array_is_rounded_as_each_of_its_values_is(values):
    expected = [rounded(v) for v in values.ravel().tolist()]
    found = np.array(rounded_list(values), object).ravel().tolist()
    assert list(map(repr, found)) == list(map(repr, expected))


@settings(max_examples=200, deadline=None)
@given(hnp.arrays(np.float32, hnp.array_shapes(max_dims=3, max_side=4)))
def test_an_array_is_written_as_its_lists_are(values):
    assert json_text({"a": [[values]]}) == json_text({"a": [[values.tolist()]]})


@pytest.mark.parametrize(
    "values",
    [np.zeros((0, 3)), np.zeros((2, 0)), np.arange(3), np.array([True]), np.array(1.5), ["é"]],
)
def test_json_is_read_back_with_the_same_values(values):
    text = json_text({"a": {"b": [{"c": values}]}})
    assert json.loads(text) == {"a": {"b": [{"c": np.asarray(values).tolist()}]}}
