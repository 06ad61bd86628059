"""Generate tf2_msgs into this Python environment, from its one-line message definition.

tf2_msgs is part of every ROS installation but not of the package index. Where cmake and a compiler
are present it is generated with the official generators, so that /tf works and is tested for real;
elsewhere everything else works without it. Run by `make`; does nothing where tf2_msgs is there.
"""

import importlib.util
import os
import re
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from pathlib import Path

GENERATORS = [
    f"ros-jazzy-{name}"
    for name in (
        "ament-cmake",
        "rosidl-default-generators",
        "rosidl-core-generators",
        "ament-package",
        "ament-cmake-include-directories",
        "ament-cmake-gmock",
        "ament-cmake-gtest",
        "ament-cmake-pytest",
        "ament-cmake-ros",
        "python-cmake-module",
    )
] + ["catkin-pkg"]

CMAKE = """\
cmake_minimum_required(VERSION 3.16)
project(tf2_msgs)
find_package(ament_cmake REQUIRED)
find_package(geometry_msgs REQUIRED)
find_package(rosidl_default_generators REQUIRED)
rosidl_generate_interfaces(${PROJECT_NAME} "msg/TFMessage.msg" DEPENDENCIES geometry_msgs)
ament_package()
"""

PACKAGE = """\
<package format="3">
  <name>tf2_msgs</name>
  <version>0.36.0</version>
  <description>tf2_msgs, generated</description>
  <maintainer email="maintainers@example.org">tccm_ros maintainers</maintainer>
  <license>BSD-3-Clause</license>
  <buildtool_depend>ament_cmake</buildtool_depend>
  <buildtool_depend>rosidl_default_generators</buildtool_depend>
  <depend>geometry_msgs</depend>
  <exec_depend>rosidl_default_runtime</exec_depend>
  <member_of_group>rosidl_interface_packages</member_of_group>
  <export><build_type>ament_cmake</build_type></export>
</package>
"""

BUILD_PYTHON = "/opt/python/"
"""Where the wheels' CMake files believe that Python is."""


def main() -> int:
    """Generate, or say why not."""
    if importlib.util.find_spec("tf2_msgs"):
        return 0
    missing = [tool for tool in ("cmake", "make", "c++") if not shutil.which(tool)]
    if missing:
        print(f"tf2_msgs is not generated ({', '.join(missing)} missing): works without /tf")
        return 0
    environment = Path(sys.prefix)
    install_generators()
    point_cmake_at(environment)
    with tempfile.TemporaryDirectory() as folder:
        build(Path(folder), environment)
    return 0


def install_generators() -> None:
    """Install the message generators from the package index."""
    command = [sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    subprocess.run([*command, *GENERATORS], check=True)


def point_cmake_at(environment: Path) -> None:
    """Replace the build machine's Python paths in the wheels' CMake files by ours."""
    include, purelib = sysconfig.get_path("include"), sysconfig.get_path("purelib")
    for path in environment.glob("share/**/*.cmake"):
        text = path.read_text(errors="surrogateescape")
        if BUILD_PYTHON not in text:
            continue
        text = re.sub(r"/opt/python/[^/;\"]+/include/python[0-9.]+", include, text)
        text = re.sub(r"/opt/python/[^/;\"]+/lib/python[0-9.]+/site-packages", purelib, text)
        path.write_text(text, errors="surrogateescape")


def build(folder: Path, environment: Path) -> None:
    """Configure, build and install the generated package."""
    (folder / "msg").mkdir()
    (folder / "msg" / "TFMessage.msg").write_text("geometry_msgs/TransformStamped[] transforms\n")
    (folder / "CMakeLists.txt").write_text(CMAKE)
    (folder / "package.xml").write_text(PACKAGE)
    paths = {
        "AMENT_PREFIX_PATH": str(environment),
        "CMAKE_PREFIX_PATH": str(environment),
        "PATH": f"{environment / 'bin'}{os.pathsep}{os.environ['PATH']}",
        "PYTHONPATH": "",
    }
    configure = [
        "cmake",
        "-S",
        str(folder),
        "-B",
        str(folder / "build"),
        f"-DPython3_EXECUTABLE={sys.executable}",
        "-DBUILD_TESTING=OFF",
        f"-DCMAKE_INSTALL_PREFIX={environment}",
    ]
    for command in (
        configure,
        ["cmake", "--build", str(folder / "build"), "--target", "install", "-j2"],
    ):
        done = subprocess.run(
            command, env=os.environ | paths, capture_output=True, text=True, check=False
        )
        if done.returncode:
            sys.exit("tf2_msgs could not be generated:\n" + (done.stdout + done.stderr)[-2000:])


if __name__ == "__main__":
    sys.exit(main())
