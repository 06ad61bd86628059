"""Layers of the package: which may import which."""

import ast
import functools
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[1] / "tccm_ros"
TESTS = Path(__file__).resolve().parent

LAYERS = [
    "errors",
    "extras",
    "atomic",
    "config",
    "blas",
    "progress",
    "stopwatch",
    "stages",
    "kernel_cache",
    "kernels",
    "arrays",
    "geometry",
    "union_find",
    "robust",
    "records",
    "cdr",
    "robot",
    "sensors",
    "cuboids",
    "outlines",
    "planes",
    "tabletop",
    "baselines",
    "signs",
    "slam",
    "rooms",
    "racks",
    "surfaces",
    "mapping",
    "scene",
    "approach",
    "ros",
    "bags",
    "results",
    "report",
    "evaluate",
    "calibrate",
    "warm_up",
    "replay",
    "view",
    "agents",
    "nodes",
    "fleet",
    "client",
    "cli",
]
"""Top to bottom; a module imports only from layers above it, or its own."""

SUBLAYERS = {
    "slam": [
        "se2",
        "odometry_model",
        "occupancy",
        "base_attitude",
        "solution",
        "factors",
        "graph",
        "matching",
        "front_end",
        "chain",
        "trajectory",
        "odometry_front_end",
        "external_poses",
        "measurements",
        "landmarks",
        "systematic",
        "walls",
        "live_estimate",
        "tracking",
        "signs",
        "loops",
        "saved_walls",
        "map_matching",
        "inliers",
        "growth",
        "wall_slam",
    ],
    "nodes": [
        "ros_types",
        "qos",
        "clock",
        "interfaces",
        "params",
        "timeline",
        "process",
        "start",
        "intake",
        "publishing",
        "solver",
        "saving",
        "signs",
        "sensor_node",
        "services",
        "clients",
        "approach",
        "map_session",
        "rerun_feed",
        "run",
        "tccm_node",
        "slam_node",
        "all_in_one",
        "managed",
        "approach_node",
        "player_node",
        "view_node",
    ],
    "surfaces": [
        "polygons",
        "displacement",
        "object_labels",
        "views",
        "merging",
        "edges",
        "identity",
        "objects",
        "labels",
        "registration",
        "saved_map",
        "surface_map",
        "surface_slam",
    ],
}
"""Order within layers that have layers of their own."""

GTSAM_LAYERS = {"slam/graph", "slam/factors"}

ROS_PACKAGES = {"rclpy", "tccm_interfaces"}
"""Beside those whose names end with _msgs or _srvs."""

FORMATS = {
    "tccm_ros.cuboids.cuboids.TICK": "unit of the integer coordinates of cuboids",
    "tccm_ros.cuboids.cuboids.TICKS_PER_M": "the same",
    "tccm_ros.cuboids.free_columns.NEVER": "marks unobserved space",
    "tccm_ros.cuboids.free_intervals.BINS": "layout of a column: one bit per bin",
    "tccm_ros.cuboids.free_intervals.WORDS": "the same",
    "tccm_ros.cuboids.union.DIGITS": "length of a scratch array",
    "tccm_ros.outlines.raster.EMPTY": "code of a cell",
    "tccm_ros.outlines.raster.FILLED": "code of a cell",
    "tccm_ros.outlines.raster.SAMPLE": "code of a cell",
    "tccm_ros.planes.inliers.NOTHING": "moments of no points",
    "tccm_ros.planes.vertical_patches.NO_RIM": "marks a patch that is no rim",
    "tccm_sim.changing.CYCLE": "timing of the simulated drive",
    "tccm_sim.changing.WALL": "place in the simulated room",
    "tccm_sim.engine.EPOCH_NS": "zero of the simulated clock",
    "tccm_sim.raycast.FACES": "codes of faces",
    "tccm_sim.rooms.CEILING": "place in the simulated room",
    "tccm_sim.situations.CYCLE_TIME": "timing of the simulated drive",
    "tccm_sim.situations.TILT_HIGH": "motion of the simulated laser",
    "tccm_sim.situations.TILT_LOW": "the same",
}
"""Numbers that tests may import: formats, marks, and scenes of the simulator (the truth)."""

ASSERTED = {
    ("cuboids/test_inclination.py", "tccm_ros.cuboids.inclination.CROSSES_CELLS_ONCE"),
    ("cuboids/test_inclination.py", "tccm_ros.cuboids.inclination.FITTED_AS_VERTICAL"),
    ("cuboids/test_inclination.py", "tccm_ros.cuboids.inclination.OUTLINED_BY_COLUMNS"),
    ("slam/matching/test_surface_normals.py", "tccm_ros.slam.matching.buckets.BUCKET"),
    ("test_robust.py", "tccm_ros.robust.MAD_TO_SIGMA"),
}
"""Numbers whose own value a test asserts: against an angle, a radius, a closed form."""


def modules() -> list[Path]:
    return sorted(path for path in PACKAGE.rglob("*.py") if path != PACKAGE / "__init__.py")


def imports(path: Path) -> set[str]:
    names = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            names.add(node.module)
            if node.module == "tccm_ros":
                names |= {f"tccm_ros.{a.name}" for a in node.names if a.name != "__version__"}
    return names


def layer_of(path: Path) -> str:
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


@pytest.mark.parametrize("path", modules(), ids=lambda p: str(p.relative_to(PACKAGE)))
def test_a_module_imports_only_layers_above_it(path: Path):
    layer = layer_of(path)
    assert layer in LAYERS, f"{layer} is not in LAYERS"
    used = {n.split(".")[1] for n in imports(path) if n.startswith("tccm_ros.")}
    below = {name for name in used - {layer} if LAYERS.index(name) > LAYERS.index(layer)}
    assert not below, f"{path.name} reaches down to {sorted(below)}"


def sub_layer(name: str, layer: str) -> str | None:
    """Return the part of a layer that a dotted name is in."""
    parts = name.split(".")
    return parts[2] if len(parts) > 2 and parts[1] == layer else None


@pytest.mark.parametrize("layer", SUBLAYERS)
def test_a_part_of_a_layer_imports_only_parts_above_it(layer: str):
    order = SUBLAYERS[layer]
    paths = [p for p in modules() if layer_of(p) == layer and p.parent != PACKAGE / layer]
    paths += [p for p in (PACKAGE / layer).glob("*.py") if p.name != "__init__.py"]
    assert paths
    for path in paths:
        own = path.relative_to(PACKAGE / layer).parts[0].removesuffix(".py")
        used = {sub_layer(name, layer) for name in imports(path)} - {None, own}
        below = {name for name in used if order.index(name) > order.index(own)}
        assert not below, f"{path.relative_to(PACKAGE)} reaches down to {sorted(below)}"


def assert_no_cycle(graph: dict[str, set[str]]) -> None:
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        pytest.fail(" imports ".join(error.args[1]))


@pytest.mark.parametrize("layer", sorted({layer_of(path) for path in modules()}))
def test_the_modules_of_a_layer_do_not_import_each_other_in_a_circle(layer: str):
    graph = {
        ".".join(("tccm_ros", *path.relative_to(PACKAGE).with_suffix("").parts)): imports(path)
        for path in modules()
        if layer_of(path) == layer and path.name != "__init__.py"
    }
    assert_no_cycle({k: v & graph.keys() for k, v in graph.items()})


def test_tests_are_in_the_folder_of_their_layer():
    folders = {p.relative_to(PACKAGE) for p in PACKAGE.rglob("*") if p.is_dir()}
    own = {Path("fuzz"), Path("interfaces"), Path("tccm_sim")}
    tests = Path(__file__).parent
    strays = {p.parent.relative_to(tests) for p in tests.rglob("test_*.py")} - folders - own
    assert strays == {Path(".")}, f"no layer of these names: {sorted(map(str, strays))}"


@pytest.mark.parametrize("path", modules(), ids=lambda p: str(p.relative_to(PACKAGE)))
def test_only_nodes_know_ros_and_only_the_graph_knows_gtsam(path: Path):
    tops = {name.split(".")[0] for name in imports(path)}
    ros = {t for t in tops if t in ROS_PACKAGES or t.endswith(("_msgs", "_srvs"))}
    assert not ros or layer_of(path) == "nodes"
    place = path.relative_to(PACKAGE)
    assert "gtsam" not in tops or {str(place), str(place.parent)} & GTSAM_LAYERS


def test_the_core_is_given_baselines_as_functions():
    cores = [path for path in modules() if layer_of(path) in {"cuboids", "planes", "slam"}]
    importers = [p for p in cores if any(n.startswith("tccm_ros.baselines") for n in imports(p))]
    assert not importers, "the processors choose a baseline and hand it down"


@pytest.mark.parametrize("path", modules(), ids=lambda p: str(p.relative_to(PACKAGE)))
def test_a_name_with_an_underscore_stays_in_its_module(path: Path):
    froms = [n for n in ast.walk(ast.parse(path.read_text())) if isinstance(n, ast.ImportFrom)]
    private = {a.name for n in froms for a in n.names if (n.module or "").startswith("tccm_ros")}
    assert not [name for name in private if name.startswith("_") and name != "__version__"]


def test_only_the_command_line_knows_the_simulator():
    knows = [p for p in modules() if any(n.split(".")[0] == "tccm_sim" for n in imports(p))]
    assert [p.name for p in knows] == ["cli.py"]


@functools.cache
def module_values(module: str) -> dict[str, ast.expr | tuple[str, str]]:
    """Return the value of each name of a module: an expression, or (module, name) of an import."""
    path = PACKAGE.parent.joinpath(*module.split("."))
    path = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
    values: dict[str, ast.expr | tuple[str, str]] = {}
    for node in ast.parse(path.read_text()).body if path.exists() else []:
        if isinstance(node, ast.ImportFrom) and node.module:
            values |= {a.asname or a.name: (node.module, a.name) for a in node.names}
        elif isinstance(node, ast.Assign | ast.AnnAssign) and node.value is not None:
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            names = [n.id for t in targets for n in ast.walk(t) if isinstance(n, ast.Name)]
            values |= dict.fromkeys(names, node.value)
    return values


def is_number(module: str, name: str) -> bool:
    """Return whether a name of a module is a number, or a tuple or array of numbers."""

    def holds(node: ast.AST) -> bool:
        match node:
            case ast.Constant(value=value):
                return isinstance(value, int | float) and not isinstance(value, bool)
            case ast.UnaryOp(operand=operand):
                return holds(operand)
            case ast.BinOp(left=left, right=right):
                return holds(left) and holds(right)
            case ast.Tuple(elts=parts) | ast.List(elts=parts) | ast.Call(args=parts):
                return bool(parts) and all(map(holds, parts))
            case ast.Name(id=other):
                return is_number(module, other)
        return ast.unparse(node) in {"math.pi", "np.pi", "math.inf", "np.inf"}

    value = module_values(module).get(name)
    return is_number(*value) if isinstance(value, tuple) else value is not None and holds(value)


def imported_numbers(path: Path) -> set[str]:
    """Return the dotted names of the numeric constants of the package that a test uses."""
    nodes = list(ast.walk(ast.parse(path.read_text())))
    froms = [n for n in nodes if isinstance(n, ast.ImportFrom) and n.module]
    names = {a.asname or a.name: (n.module, a.name) for n in froms for a in n.names}
    used = [value for value in names.values() if value[1].isupper()]
    for node in nodes:
        match node:
            case ast.Attribute(value=ast.Name(id=name), attr=attr) if attr.isupper():
                if name in names:
                    used.append((".".join(names[name]), attr))
    ours = [(m, name) for m, name in used if m.split(".")[0] in {"tccm_ros", "tccm_sim"}]
    return {f"{m}.{name}" for m, name in ours if is_number(m, name)}


def test_expected_numbers_are_written_in_the_tests():
    """A test that imports a number of the package changes with it, and cannot find it wrong."""
    used = {
        (str(path.relative_to(TESTS)), name)
        for path in TESTS.rglob("*.py")
        for name in imported_numbers(path)
    }
    rest = {(path, name) for path, name in used if name not in FORMATS}
    assert rest == ASSERTED, "write the number, its unit and its reason in the test"
    assert {name for _, name in used} - {name for _, name in ASSERTED} == set(FORMATS)


@pytest.mark.parametrize("path", sorted(TESTS.rglob("test_*.py")), ids=lambda p: p.stem)
def test_names_of_tests_are_70_characters_or_shorter(path: Path):
    """A name has subject, condition and result; a docstring has the rest."""
    nodes = ast.walk(ast.parse(path.read_text()))
    names = {n.name for n in nodes if isinstance(n, ast.FunctionDef)}
    assert not {name for name in names if name.startswith("test_") and len(name) > 70}
