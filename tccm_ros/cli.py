"""The `tccm` command.

Exit status: 0 done; 1 an error that one line explains; 2 wrong usage. The help of an option is its
description. Modules are imported where they are used, so that `tccm --help` is quick.
"""

from __future__ import annotations

import json
import signal
import sys
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from tccm_ros import __version__
from tccm_ros.blas import use_one_thread
from tccm_ros.errors import ConfigError, MissingExtraError, OutputError, TccmError, one_line
from tccm_ros.extras import FLEET, check_extra

if TYPE_CHECKING:
    from tccm_ros.config import Config
    from tccm_ros.replay.replay import Watcher

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    help="Surface maps for mobile manipulators, from lasers, depth cameras and 3D lidars.",
)

BagArgument = Annotated[Path, typer.Argument(help="a rosbag2 folder, an .mcap or a .db3 file")]
BagsArgument = Annotated[
    list[Path], typer.Argument(help="a recording: one bag, or several that are read as one")
]
ConfigOption = Annotated[Path | None, typer.Option("--config", help="a YAML parameter file")]
SetOption = Annotated[list[str], typer.Option("--set", help="group.key=value; may be repeated")]
RemapOption = Annotated[
    list[str], typer.Option("--remap", help="input:=/topic, for example scan:=/base_scan")
]
QuietOption = Annotated[bool, typer.Option("--quiet", "-q", help="print nothing but errors")]
JsonOption = Annotated[bool, typer.Option("--json", help="print the result as JSON")]
WorkersOption = Annotated[int, typer.Option(min=1, help="processes on this machine")]
MemoryOption = Annotated[
    str, typer.Option(help="memory limit of a worker, for example 4GiB; auto: an equal part")
]
SchedulerOption = Annotated[
    str, typer.Option(help="a running Dask scheduler in place of these: tcp://host:port")
]


@app.callback(invoke_without_command=True)
def _common(
    version: Annotated[bool, typer.Option("--version", help="print the version")] = False,
    debug: Annotated[bool, typer.Option("--debug", help="show tracebacks")] = False,
) -> None:
    if version:
        typer.echo(__version__)
        raise typer.Exit


@app.command()
def replay(
    bag: BagsArgument,
    out: Annotated[Path, typer.Option("--out", help="folder for the results")],
    map: Annotated[
        Path | None, typer.Option("--map", help="map to continue: map.mcap, or its folder")
    ] = None,
    config: ConfigOption = None,
    set: SetOption = [],  # noqa: B006
    remap: RemapOption = [],  # noqa: B006
    pictures: Annotated[bool, typer.Option(help="draw map.png, map3d.png, report.html")] = True,
    events: Annotated[
        bool,
        typer.Option("--events", help="also events in result.mcap: solve after each view"),
    ] = False,
    rerun: Annotated[
        Path | None, typer.Option("--rerun", help="also an .rrd for the Rerun viewer (extra: view)")
    ] = None,
    quiet: QuietOption = False,
    as_json: JsonOption = False,
) -> None:
    """Compute planes, walls, a trajectory and a surface map from a recorded bag."""
    from tccm_ros.config.reader import read_config
    from tccm_ros.progress import progress
    from tccm_ros.replay.replay import replay as run

    settings = read_config(config, set)
    if map is not None and map.is_dir():
        map /= "map.mcap"
    with _rerun_log(rerun, settings) as watcher, progress(quiet or as_json) as bars:
        summary = run(
            bag, out, settings, saved_map=map, remap=remap, pictures=pictures, events=events,
            watcher=watcher, bars=bars,
        )  # fmt: skip
    _print_result(summary, quiet, as_json)


@app.command()
def demo(
    out: Annotated[Path, typer.Option("--out", help="folder for the results")] = Path("tccm_demo"),
    browser: Annotated[bool, typer.Option(help="open the report in the browser")] = True,
    quiet: QuietOption = False,
) -> None:
    """Map the simulated flat that comes with the package, and open the report."""
    from tccm_ros.config import Config
    from tccm_ros.progress import progress
    from tccm_ros.replay.replay import replay as run
    from tccm_ros.report.viewing import view as show
    from tccm_sim.bundled import DEMO

    with progress(quiet) as bars:
        summary = run([DEMO], out, Config(), bars=bars)
    _print_result(summary, quiet)
    if browser:
        with suppress(OutputError):  # without a browser; the summary names the report
            show(out)


@app.command()
def fleet(
    bags: Annotated[
        list[str],
        typer.Argument(help="bags, folders, patterns, URLs; '-' reads them from standard input"),
    ],
    out: Annotated[Path, typer.Option("--out", help="folder of the fleet")],
    workers: WorkersOption = 1,
    memory: MemoryOption = "auto",
    scheduler: SchedulerOption = "",
    config: ConfigOption = None,
    set: SetOption = [],  # noqa: B006
    remap: RemapOption = [],  # noqa: B006
    pictures: Annotated[bool, typer.Option(help="draw pictures and reports")] = True,
    quiet: QuietOption = False,
    as_json: JsonOption = False,
) -> None:
    """Replay many recordings, on many workers; a second run resumes the first.

    Status 1 where a recording failed. Needs the extra fleet (docs/guides/installing.md).
    """
    check_extra("fleet", *FLEET)
    from tccm_ros.config.reader import read_config
    from tccm_ros.fleet.cluster import Workers
    from tccm_ros.fleet.run import run_fleet
    from tccm_ros.progress import progress

    settings = read_config(config, set)
    sources = [source for bag in bags for source in (_lines() if bag == "-" else [bag])]
    with _resumable(), progress(quiet or as_json) as bars:
        summary = run_fleet(
            sources, out, settings, workers=Workers(workers, memory, scheduler), remap=remap,
            pictures=pictures, bars=bars,
        )  # fmt: skip
    _print_result(summary, quiet, as_json)
    if summary.failures:
        raise typer.Exit(1)


@app.command()
def merge(
    maps: Annotated[
        list[Path], typer.Argument(help="maps, folders with a map.mcap, folders of fleets")
    ],
    out: Annotated[Path, typer.Option("--out", help="folder of the merged map")],
    same_building: Annotated[
        bool, typer.Option("--same-building", help="treat identical map files as the same building")
    ] = False,
    workers: WorkersOption = 1,
    memory: MemoryOption = "auto",
    scheduler: SchedulerOption = "",
    config: ConfigOption = None,
    set: SetOption = [],  # noqa: B006
    quiet: QuietOption = False,
    as_json: JsonOption = False,
) -> None:
    """Merge maps of one building into one; those that share nothing stay components of their own.

    Needs the extra fleet (docs/guides/installing.md).
    """
    check_extra("fleet", *FLEET)
    from tccm_ros.config.reader import read_config
    from tccm_ros.fleet.cluster import Workers
    from tccm_ros.fleet.merge import merge_maps
    from tccm_ros.progress import progress

    settings = read_config(config, set)
    with progress(quiet or as_json) as bars:
        summary = merge_maps(
            maps, out, settings, same_building=same_building,
            workers=Workers(workers, memory, scheduler), bars=bars,
        )  # fmt: skip
    _print_result(summary, quiet, as_json)


@app.command()
def find(
    query: Annotated[
        str, typer.Argument(help="SQL; the tables are surfaces, objects, walls and signs")
    ],
    folder: Annotated[Path, typer.Option("--in", help="folder of a fleet")],
    as_json: JsonOption = False,
) -> None:
    """Ask all maps of a fleet in SQL, also while it runs.

    Needs the extra fleet (docs/guides/installing.md).
    """
    check_extra("fleet", *FLEET)
    from tccm_ros.fleet.catalogue import Catalogue
    from tccm_ros.fleet.layout import FleetFolder

    _print_result(Catalogue(FleetFolder(folder).catalogue).ask(query), as_json=as_json)


@app.command()
def info(path: BagArgument, as_json: JsonOption = False) -> None:
    """Show the contents of a bag and what a replay of it would miss, or those of a saved map."""
    from tccm_ros.replay.info import bag_info
    from tccm_ros.results.map_file import is_map
    from tccm_ros.results.map_info import map_info

    _print_result(map_info(path) if is_map(path) else bag_info(path), as_json=as_json)


@app.command()
def simulate(
    world: Annotated[str, typer.Argument(help="a world; 'list' names them")],
    out: Annotated[Path, typer.Argument(help="folder of the bag")] = Path("."),
    seed: Annotated[int, typer.Option(help="the same seed gives the same bytes")] = 0,
    set: Annotated[list[str], typer.Option("--set", help="option=value; may be repeated")] = [],  # noqa: B006
    overwrite: Annotated[bool, typer.Option(help="replace a bag that is there")] = False,
    quiet: QuietOption = False,
) -> None:
    """Simulate a robot in a world and write its bag and the truth."""
    from tccm_ros.progress import FractionBar, progress
    from tccm_sim.options import options_from_settings
    from tccm_sim.recording import simulate as run
    from tccm_sim.worlds import WORLDS

    if world == "list":
        typer.echo("\n".join(f"{name:<12} {meaning}" for name, (_, meaning) in WORLDS.items()))
        return
    options = options_from_settings(_settings(set))
    with progress(quiet) as bars:
        bar = FractionBar(bars, "simulate")
        folder = run(world, out, seed=seed, options=options, overwrite=overwrite, progress=bar)
    _say(f"{folder}: bag with truth.json and truth.tum", quiet)


@app.command()
def evaluate(
    folder: Annotated[Path, typer.Argument(help="result folder of replay")],
    truth: Annotated[
        list[Path],
        typer.Option("--truth", help="truth.json, a TUM, relations or reference file; repeatable"),
    ],
    stamps: Annotated[
        Path | None, typer.Option("--stamps", help="stamps.csv of an imported log")
    ] = None,
    plot: Annotated[Path | None, typer.Option("--plot", help="PNG of the trajectories")] = None,
    as_json: JsonOption = False,
) -> None:
    """Compare surfaces and trajectory with the truth."""
    from tccm_ros.evaluate.score import score_trajectory
    from tccm_ros.evaluate.surfaces import score_surfaces

    for path in truth:
        if path.suffix == ".json":
            _print_result(score_surfaces(folder / "surfaces.json", path), as_json=as_json)
            continue
        poses = score_trajectory(folder / "trajectory.tum", path, stamps=stamps)
        _print_result(poses, as_json=as_json)
        if plot is not None:
            from tccm_ros.evaluate.plot import plot_score

            plot_score(poses, plot)


@app.command()
def view(
    target: Annotated[Path, typer.Argument(help="a result folder, a map or a bag")],
    rerun: Annotated[
        bool, typer.Option("--rerun", help="in the Rerun viewer instead (extra: view)")
    ] = False,
) -> None:
    """Open the report in the browser; for a map or a bag it is built first.

    While a replay writes the folder, a page shows the growing map (extra: view).
    """
    from tccm_ros.config import Config
    from tccm_ros.progress import progress
    from tccm_ros.replay.replay import report_of
    from tccm_ros.report.viewing import view as show

    if rerun:
        check_extra("view", "rerun")
        from tccm_ros.view.rerun_viewer import open_rerun, rerun_of

        with progress() as bars:
            recording = rerun_of(target, Config(), bars)
        _say(str(open_rerun(recording)))
        return
    _show_running(target)
    with progress() as bars:
        report = report_of(target, Config(), bars)
    _say(str(show(report)))


@app.command()
def mcp(
    map: Annotated[Path | None, typer.Argument(help="a saved map, or its folder")] = None,
    live: Annotated[bool, typer.Option("--live", help="the map of a running slam_node")] = False,
    node: Annotated[
        str, typer.Option("--node", help="name of that node, with its namespace")
    ] = "surface_slam",
    allow_motion: Annotated[
        bool, typer.Option("--allow-motion", help="with --live: agents may drive the base too")
    ] = False,
    approach_node: Annotated[
        str, typer.Option("--approach-node", help="name of the node that drives")
    ] = "approach",
    config: ConfigOption = None,
    set: SetOption = [],  # noqa: B006
) -> None:
    """Answer language agents' questions about a map, by the Model Context Protocol on stdio.

    Nothing is written, and nothing moves without --allow-motion. Needs the extra
    agents (docs/guides/installing.md).
    """
    if live == (map is not None):
        raise typer.BadParameter("give a saved map, or --live")
    if allow_motion and not live:
        raise typer.BadParameter("--allow-motion is only with --live: a saved map has no robot")
    check_extra("agents", "mcp")
    from tccm_ros.agents.server import make_server

    if map is None:
        with _live_robot(node, approach_node if allow_motion else "") as (source, motion):
            make_server(source, motion).run()
        return
    from tccm_ros.agents.saved_source import SavedMapSource
    from tccm_ros.config.reader import read_config

    make_server(SavedMapSource.load(map, read_config(config, set))).run()


@app.command()
def compare(
    before: Annotated[Path, typer.Argument(help="result folder of the earlier map")],
    after: Annotated[Path, typer.Argument(help="result folder of the later map")],
    out: Annotated[
        Path | None, typer.Option("--out", help="folder for a picture and a page")
    ] = None,
    lay_over: Annotated[
        bool, typer.Option("--lay-over", help="the maps have different frames: align them")
    ] = False,
) -> None:
    """Show which surfaces are new, gone or moved between two maps."""
    from tccm_ros.report.compare import compare as run
    from tccm_ros.report.compare_page import write_comparison

    comparison = run(before, after, lay_over=lay_over)
    _say(comparison.text())
    if out is not None:
        picture, page = write_comparison(comparison, out)
        _say(f"picture   {picture}\npage      {page}")


@app.command()
def calibrate(
    bags: Annotated[
        list[Path], typer.Argument(metavar="BAG...", help="one or several bags of one rig")
    ],
    out: Annotated[Path, typer.Option("--out", help="the parameter file")] = Path("rig.yaml"),
    floor_z: Annotated[
        float | None, typer.Option("--floor-z", help="height of the floor in the base frame, m")
    ] = None,
    config: ConfigOption = None,
    set: SetOption = [],  # noqa: B006
    remap: RemapOption = [],  # noqa: B006
    quiet: QuietOption = False,
    as_json: JsonOption = False,
) -> None:
    """Estimate zeros, scale, roll, height and delay of a tilting laser, or a head with a camera."""
    from tccm_ros.calibrate.calibration import calibrate as run
    from tccm_ros.calibrate.files import write_calibration
    from tccm_ros.config.reader import read_config
    from tccm_ros.progress import progress

    settings = read_config(config, set)
    with progress(quiet or as_json) as bars:
        found = run(bags, settings, remap, floor_z=floor_z, bars=bars)
        bars.start("picture", 1.0)
        rig, result, picture = write_calibration(found, out)
    _print_result(found, quiet, as_json)
    files = f"rig       {rig}  (use it with --config)\nresult    {result}\npicture   {picture}"
    _say(f"{files}  (before and after)", quiet or as_json)


@app.command("import-carmen")
def import_carmen(
    log: Annotated[Path, typer.Argument(help="a CARMEN log, also .gz or .bz2")],
    out: Annotated[Path, typer.Argument(help="folder of the bag")],
    quiet: QuietOption = False,
) -> None:
    """Convert a CARMEN log to a bag."""
    from tccm_ros.progress import progress
    from tccm_sim.carmen import import_carmen as run

    with progress(quiet) as bars:
        counts = run(log, out, bars=bars)
    _say(f"{out}: {counts}", quiet)


@app.command()
def recover(
    bag: Annotated[Path, typer.Argument(help="a truncated or damaged .mcap")],
    out: Annotated[Path, typer.Argument(help="folder of the new bag")],
    quiet: QuietOption = False,
) -> None:
    """Write the readable messages of a damaged bag into a new one."""
    from tccm_ros.bags.recover import recover as run
    from tccm_ros.progress import progress

    with progress(quiet) as bars:
        counts = run(bag, out, bars=bars)
    _say(f"{out}: {counts}", quiet)


@app.command()
def signs(
    images: Annotated[list[Path], typer.Argument(metavar="IMAGE...", help="pictures: JPEG, PNG")],
    config: ConfigOption = None,
    set: SetOption = [],  # noqa: B006
) -> None:
    """Detect and read the door signs of pictures; print a line of JSON for each picture."""
    from tccm_ros.config.reader import read_config
    from tccm_ros.replay.picture_files import signs_of_pictures

    for line in signs_of_pictures(images, read_config(config, set).signs):
        typer.echo(json.dumps(line, ensure_ascii=False))


@app.command()
def parameters() -> None:
    """Print every parameter as a YAML file: default, unit, range, meaning."""
    from tccm_ros.config.reference import as_yaml

    typer.echo(as_yaml(), nl=False)


def _show_running(out: Path) -> None:
    """Show the growing map of a replay that writes a folder, if there is one, until it ends."""
    import webbrowser

    from tccm_ros.replay.unfinished_maps import running_replay

    maps = running_replay(out)
    if maps is None:
        return
    check_extra("view", "aiohttp")
    from tccm_ros.view.replay_page import show_replay

    def open_page(url: str) -> None:
        typer.echo(f"a replay is writing {out}: {url}")
        webbrowser.open(url)

    with suppress(FileNotFoundError):  # it has just ended
        show_replay(maps, open_page)


def _rerun_log(path: Path | None, config: Config) -> AbstractContextManager[Watcher | None]:
    if path is None:
        return nullcontext()
    check_extra("view", "rerun")
    from tccm_ros.view.rerun_log import rerun_file

    return rerun_file(path, config)


@contextmanager
def _resumable() -> Iterator[None]:
    """Turn an interrupt into a sentence and status 130."""
    try:
        yield
    except KeyboardInterrupt:
        typer.echo("tccm: stopped; run the same command again to go on", err=True)
        raise typer.Exit(130) from None


def _live_robot(node: str, approach_node: str) -> AbstractContextManager[tuple[Any, Any]]:
    """Connect to the map of a running slam_node, and to the node that drives, if it has a name."""
    check_extra("ros", "rclpy")
    from tccm_ros.nodes.interfaces import missing_interfaces

    if missing_interfaces():
        raise MissingExtraError(f"the live map: {missing_interfaces()}")
    from tccm_ros.nodes.clients.running_robot import live_robot

    # A signal ends the server as the end of its input does: a drive in progress is cancelled.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    return live_robot(node, approach_node)


def _lines() -> list[str]:
    return [line.strip() for line in sys.stdin if line.strip()]


def _settings(texts: list[str]) -> dict[str, str]:
    pairs = {}
    for text in texts:
        key, equals, value = text.partition("=")
        if not equals:
            raise ConfigError(f"'{text}' is not a setting; write option=value")
        pairs[key.strip()] = value.strip()
    return pairs


def _print_result(result: Any, quiet: bool = False, as_json: bool = False) -> None:
    """Print a result, by its methods `to_json` and `text`."""
    if as_json:
        typer.echo(json.dumps(result.to_json(), indent=1))
    else:
        _say(result.text(), quiet)


def _say(text: str, quiet: bool = False) -> None:
    if not quiet:
        typer.echo(text)


def main() -> None:
    """Run the command and turn errors into one line and an exit status."""
    arguments = [argument for argument in sys.argv[1:] if argument != "--debug"]
    debug = len(arguments) < len(sys.argv) - 1
    use_one_thread()
    try:
        app(arguments)
    except TccmError as error:
        if debug:
            raise
        _fail(one_line(error))
    except BrokenPipeError:
        sys.exit(1)
    except Exception as error:
        if debug:
            raise
        _fail(
            f"unexpected {type(error).__name__}: {one_line(error)}; run with --debug and report it"
        )


def _fail(text: str) -> None:
    print(f"tccm: {text}", file=sys.stderr)
    sys.exit(1)


if __name__ == "__main__":
    main()
