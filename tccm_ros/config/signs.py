"""Parameters of door signs."""

from __future__ import annotations

from typing import Literal

from tccm_ros.config.parameter import Group, param


class SignsConfig(Group):
    """Door signs that a camera reads."""

    enabled: bool = param(
        True, "look for door signs in the pictures of cameras (extra signs)", read_only=True
    )
    rate: float = param(
        2.0,
        "pictures that are looked at in a second of their stamps; the others are counted",
        unit="Hz",
        gt=0.0,
        le=30.0,
        read_only=True,
    )
    detector: Literal["text", "published"] = param(
        "text",
        "text: all text of a picture, then which of it is a sign; published: regions by saliency, "
        "HOG and SVM, as the surface mapping paper",
        read_only=True,
    )
    detector_side: int = param(
        736,
        "short side of a picture as it is searched for text by signs.detector text; a larger one "
        "finds smaller text and takes longer",
        unit="px",
        ge=128,
        le=2048,
        read_only=True,
    )
