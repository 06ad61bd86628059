import numpy as np
import pytest

from tccm_ros.baselines.line_ransac import label_by_ransac
from tccm_ros.config import Config
from tccm_ros.slam.lines import label_by_splitting
from tccm_ros.surfaces.surface_slam import SurfaceSlam


@pytest.fixture(scope="module")
def beams() -> np.ndarray:
    """A corner of two noisy walls, on which the two methods do not give the same labels."""
    rng = np.random.default_rng(4)
    along = np.linspace(0.0, 3.0, 120)
    far = np.column_stack((np.full(120, 2.0), along - 1.0))
    side = np.column_stack((2.0 - along, np.full(120, 2.0)))
    return np.concatenate((far, side)) + rng.normal(0.0, 0.02, (240, 2))


@pytest.mark.parametrize(
    ("extractor", "label"), [("split_merge", label_by_splitting), ("ransac", label_by_ransac)]
)
def test_the_setting_of_the_extractor_chooses_the_labelling_of_beams(extractor, label, beams):
    config = Config()
    config.lines.extractor = extractor
    labels = SurfaceSlam(config).walls.label(beams, config)
    other = label_by_ransac if extractor == "split_merge" else label_by_splitting
    assert np.array_equal(labels, label(beams, config))
    assert not np.array_equal(labels, other(beams, config))
