import pytest

from tccm_ros.baselines.line_ransac import label_by_ransac
from tccm_ros.config import Config
from tccm_ros.slam.lines import label_by_splitting
from tccm_ros.surfaces.surface_slam import SurfaceSlam


@pytest.mark.parametrize(
    ("extractor", "label"), [("split_merge", label_by_splitting), ("ransac", label_by_ransac)]
)
def test_the_setting_of_the_extractor_chooses_the_labelling_of_beams(extractor, label):
    config = Config()
    config.lines.extractor = extractor
    assert SurfaceSlam(config).walls.label is label
