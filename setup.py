"""Install tccm_ros as an ament_python package."""

from pathlib import Path

from setuptools import find_packages, setup

PACKAGE = "tccm_ros"


def files(folder: str, *patterns: str) -> list[str]:
    """Return the files of a folder that match any of the patterns, sorted."""
    return sorted(str(path) for pattern in patterns for path in Path(folder).glob(pattern))


setup(
    name=PACKAGE,
    version="0.1.0",
    packages=find_packages(include=[PACKAGE, f"{PACKAGE}.*", "tccm_sim"]),
    package_data={
        PACKAGE: [
            "py.typed",
            "report/viewer/*",
            "fleet/viewer/*",
            "ros/definitions/*.msg",
            "ros/public_definitions/*/msg/*.msg",
            "signs/weights.npz",
        ],
    },
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
        (f"share/{PACKAGE}/config", files("config", "*.yaml", "*.rviz", "*.json", "*.xml")),
        (f"share/{PACKAGE}/config/robots", files("config/robots", "*.yaml")),
        (f"share/{PACKAGE}/launch", files("launch", "*.py")),
    ],
    python_requires=">=3.11",
    extras_require={
        "fleet": ["dask[distributed]>=2025.1", "duckdb>=1.1", "fsspec>=2025.1", "pyarrow>=16"],
        "signs": ["rapidocr-onnxruntime>=1.4,<1.5"],
    },
    zip_safe=False,
    maintainer="tccm_ros maintainers",
    maintainer_email="maintainers@example.org",
    description="Surface maps for mobile manipulators from a tilting and a level laser.",
    license="Apache-2.0",
    entry_points={
        "console_scripts": [
            "tccm_node = tccm_ros.nodes.start:tccm_node",
            "slam_node = tccm_ros.nodes.start:slam_node",
            "managed_tccm_node = tccm_ros.nodes.start:managed_tccm_node",
            "managed_slam_node = tccm_ros.nodes.start:managed_slam_node",
            "player_node = tccm_ros.nodes.start:player_node",
            "all_in_one = tccm_ros.nodes.start:all_in_one",
            "tccm = tccm_ros.cli:main",
        ],
    },
)
