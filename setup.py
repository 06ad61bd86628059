"""Install tccm_ros as an ament_python package.

This file alone says what the package is, needs and installs: colcon and pip both read it.
"""

from pathlib import Path

from setuptools import find_packages, setup

PACKAGE = "tccm_ros"

REQUIRED = [
    "numpy>=1.26,<3",
    "scipy>=1.11.4,<2",  # before, connected_components fails on 64-bit indices
    "numba>=0.60,<0.69",  # kernel_cache.py rests on parts of numba that are not public
    "gtsam>=4.3,<4.4",
    "shapely>=2.1,<3",
    "mapbox_earcut>=2.0,<3",
    "rosbags>=0.11.9,<0.12",  # bags/storage.py checks what this minor version leaves unchecked
    "mcap>=1.2.1,<2",  # brings lz4
    "zstandard>=0.22",
    "pydantic>=2.7,<3",
    "pyyaml>=6.0",
    "typer>=0.16",
    "rich>=13",
    "matplotlib>=3.10",
    "pillow>=10",
]
"""What the command `tccm` needs, without ROS."""

EXTRAS = {
    # ROS 2 Jazzy as wheels, for machines without ROS; always the ros-jazzy- names.
    "ros": [
        "ros-jazzy-rclpy>=7.1,<7.2",
        "ros-jazzy-common-interfaces>=5.3,<5.4",
        "ros-jazzy-rmw-fastrtps-cpp>=8.4,<8.5",
    ],
    # Its networks are read from its folder; the package itself, with OpenCV, is not imported.
    "signs": ["rapidocr-onnxruntime>=1.4,<1.5"],
    "view": ["rerun-sdk>=0.41,<0.42", "aiohttp>=3.11,<4"],
    "agents": ["mcp>=2.3,<3"],
    "fleet": ["dask[distributed]>=2025.1", "duckdb>=1.1", "fsspec>=2025.1", "pyarrow>=16"],
}
EXTRAS["all"] = [requirement for extra in EXTRAS.values() for requirement in extra]
# ROS 2 Kilted in place of Jazzy: `make test DISTRO=kilted`.
EXTRAS["ros-kilted"] = [
    "ros-kilted-rclpy>=9.1,<9.2",
    "ros-kilted-common-interfaces>=5.5,<5.6",
    "ros-kilted-rmw-fastrtps-cpp>=9.3,<9.4",
]


def files(folder: str, *patterns: str) -> list[str]:
    """Return the files of a folder that match any of the patterns, sorted."""
    return sorted(str(path) for pattern in patterns for path in Path(folder).glob(pattern))


setup(
    name=PACKAGE,
    version="0.2.0",
    packages=find_packages(include=[PACKAGE, f"{PACKAGE}.*", "tccm_sim"]),
    package_data={
        PACKAGE: [
            "py.typed",
            "report/viewer/*",
            "view/live/*",
            "fleet/viewer/*",
            "ros/definitions/*.msg",
            "ros/public_definitions/*/msg/*.msg",
            "signs/weights.npz",
        ],
        "tccm_sim": ["demo/*"],
    },
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
        (f"share/{PACKAGE}/config", files("config", "*.yaml", "*.rviz", "*.json", "*.xml")),
        (f"share/{PACKAGE}/config/robots", files("config/robots", "*.yaml")),
        (f"share/{PACKAGE}/launch", files("launch", "*.py")),
    ],
    python_requires=">=3.11",
    install_requires=REQUIRED,
    extras_require=EXTRAS,
    zip_safe=False,
    maintainer="tccm_ros maintainers",
    maintainer_email="maintainers@example.org",
    description="Surface maps for mobile manipulators from lasers, depth cameras and 3D lidars.",
    long_description=Path("README.md").read_text(encoding="utf-8"),
    long_description_content_type="text/markdown",
    license="Apache-2.0",
    entry_points={
        "console_scripts": [
            "tccm_node = tccm_ros.nodes.start:tccm_node",
            "slam_node = tccm_ros.nodes.start:slam_node",
            "managed_tccm_node = tccm_ros.nodes.start:managed_tccm_node",
            "managed_slam_node = tccm_ros.nodes.start:managed_slam_node",
            "view_node = tccm_ros.nodes.start:view_node",
            "approach_node = tccm_ros.nodes.start:approach_node",
            "player_node = tccm_ros.nodes.start:player_node",
            "all_in_one = tccm_ros.nodes.start:all_in_one",
            "tccm = tccm_ros.cli:main",
        ],
    },
)
