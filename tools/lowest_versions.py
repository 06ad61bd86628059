"""Print the lowest version of each requirement of `setup.py`, as constraints for pip.

Usage: python tools/lowest_versions.py > FILE (`make test-lowest`)
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from importlib import metadata

LOWEST = re.compile(r"(?P<name>[\w.-]+)[^;]*>=(?P<version>[\d.]+)")


def lowest(requirements: Iterable[str]) -> list[str]:
    """Return lines such as ``numpy==1.26``; requirements of extras are left out.

    Raises
    ------
    ValueError
        If a requirement has no lowest version.
    """
    lines = []
    for requirement in requirements:
        if "extra ==" in requirement:
            continue
        found = LOWEST.match(requirement)
        if found is None:
            raise ValueError(f"{requirement}: no lowest version; write {requirement}>=...")
        lines.append(f"{found['name']}=={found['version']}")
    return lines


if __name__ == "__main__":
    print("\n".join(lowest(metadata.requires("tccm_ros") or ())))
