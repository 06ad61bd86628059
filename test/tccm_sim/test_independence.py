"""The simulator shares no geometry with the mapping side, else sign errors would cancel."""

import ast
from pathlib import Path

import tccm_sim

FORBIDDEN = {"geometry", "robot", "sensors", "cuboids", "planes", "mapping", "slam", "surfaces"}


def test_the_simulator_imports_no_geometry_of_the_mapping_side():
    folder = Path(tccm_sim.__file__).parent
    files = sorted(p for p in folder.glob("*.py") if not p.name.startswith("carmen"))
    assert len(files) > 10
    for file in files:
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom):
                names = [node.module or "", *(f"{node.module}.{a.name}" for a in node.names)]
            elif isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            else:
                continue
            for name in names:
                parts = name.split(".")
                assert parts[0] != "tccm_ros" or len(parts) < 2 or parts[1] not in FORBIDDEN, (
                    f"{file.name} imports {name}"
                )
