"""The command line: what each command is called and which options it takes. What they do is in ``commands/``.

Nothing heavy is imported here, so that ``--help`` answers at once: a command imports its module when it runs.
"""

import gc
import os
import signal
import sys
import traceback
from collections.abc import Sequence
from contextlib import suppress
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any

import typer

from pfslam_viz import __version__, streams
from pfslam_viz.commands.options import (
    CAMERA,
    FILTER,
    JUDGE,
    RECORDINGS,
    RUN,
    SINKS,
    BaseFrameOpt,
    BindOpt,
    ConfigOpt,
    ConfigsOpt,
    ConnectOpt,
    DataOpt,
    ForceOpt,
    JsonOpt,
    MapEveryOpt,
    MaxBeamsOpt,
    MaxParticlesOpt,
    OdomTopicOpt,
    ParticlesOpt,
    QuietOpt,
    RecordingArg,
    RobotOpt,
    SaveOpt,
    ScanTopicOpt,
    SeedOpt,
    ServeOpt,
    SetOpt,
    SpawnOpt,
    StartOpt,
    StdoutOpt,
    StopOpt,
    StrideOpt,
    WebOpt,
)
from pfslam_viz.errors import InputError, PfslamError
from pfslam_viz.names import readable
from pfslam_viz.spared import spared

PROGRAM = "pfslam-viz"

app = typer.Typer(
    name=PROGRAM,
    help="Interactive replay of particle-filter SLAM in the Rerun viewer.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    context_settings={"help_option_names": ["-h", "--help"]},
)


def examples(*lines: str) -> str:
    """An epilog with one example a line."""
    return "\n\n".join(["[bold]Examples[/bold]", *(f"  {PROGRAM} {line}" for line in lines)])


def _show_version(value: bool) -> None:
    if value:
        streams.write_result(f"{PROGRAM} {__version__}\n")
        raise typer.Exit()


@app.callback()
def options(
    version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Print the version.")
    ] = False,
    debug: Annotated[
        bool, typer.Option("--debug", help="Show the traceback of an error, and where compiled kernels are kept.")
    ] = False,
) -> None:
    """Interactive replay of particle-filter SLAM in the Rerun viewer."""


@app.command(
    rich_help_panel=RUN,
    epilog=examples(
        "replay demo --save demo.rrd",
        "replay 21 --config paper --particles 100",
        "replay corridor.clf --spawn --save corridor.rrd",
        "replay 21 --export results/",
    ),
)
def replay(
    recording: RecordingArg,
    save: SaveOpt = None,
    spawn: SpawnOpt = False,
    serve: ServeOpt = False,
    web: WebOpt = False,
    bind: BindOpt = "127.0.0.1",
    connect: ConnectOpt = None,
    stdout: StdoutOpt = False,
    export: Annotated[
        Path | None,
        typer.Option(
            "--export", metavar="DIR", help="Write trajectories, map and metrics as files.", rich_help_panel=SINKS
        ),
    ] = None,
    config: ConfigOpt = None,
    settings: SetOpt = None,
    particles: ParticlesOpt = None,
    seed: SeedOpt = None,
    data: DataOpt = None,
    robot: RobotOpt = None,
    start: StartOpt = 0,
    stop: StopOpt = None,
    stride: StrideOpt = 1,
    scan_topic: ScanTopicOpt = None,
    odom_topic: OdomTopicOpt = None,
    base_frame: BaseFrameOpt = None,
    force: ForceOpt = False,
    map_every: MapEveryOpt = None,
    max_particles: MaxParticlesOpt = None,
    max_beams: MaxBeamsOpt = None,
    quiet: QuietOpt = False,
) -> None:
    """Run the filter over a recording and stream every step to Rerun.

    Without a place to send it to, the viewer is opened.
    """
    from pfslam_viz.commands import replay as command
    from pfslam_viz.commands.choices import ConfigChoice, DetailChoice, RecordingChoice, SinkChoice

    command.run(
        RecordingChoice(recording, data, robot, start, stop, stride, scan_topic, odom_topic, base_frame, force),
        ConfigChoice(config, tuple(settings or ()), particles, seed),
        SinkChoice(save, spawn, serve, bind, connect, stdout, web),
        DetailChoice(map_every, max_particles, max_beams),
        export,
        quiet,
    )


@app.command(rich_help_panel=RECORDINGS, epilog=examples("recordings", "recordings --data ~/slam --json"))
def recordings(data: DataOpt = None, json: JsonOpt = False) -> None:
    """List the recordings that have a name: what they are, and whether they are here."""
    from pfslam_viz.commands import recordings as command

    command.run_list(data, json)


@app.command(rich_help_panel=RECORDINGS, epilog=examples("info 21", "info log.clf --json"))
def info(
    recording: RecordingArg,
    data: DataOpt = None,
    robot: RobotOpt = None,
    scan_topic: ScanTopicOpt = None,
    odom_topic: OdomTopicOpt = None,
    base_frame: BaseFrameOpt = None,
    verbose: Annotated[bool, typer.Option("--verbose", "-v", help="Everything: rates, spans, gaps, paths.")] = False,
    json: JsonOpt = False,
) -> None:
    """Say whether a recording is good, what is inside it, and what is wrong with it."""
    from pfslam_viz.commands import recordings as command

    command.run_info(
        recording, data, robot, json, verbose, scan_topic=scan_topic, odom_topic=odom_topic, base_frame=base_frame
    )


@app.command(
    rich_help_panel=RECORDINGS, epilog=examples("fetch 21", "fetch 21 --rgbd --every 4", "fetch intel --data ~/slam")
)
def fetch(
    name: Annotated[str, typer.Argument(metavar="NAME", help="20, 21, 23, intel, fr079, aces or mit-csail.")],
    data: DataOpt = None,
    rgbd: Annotated[bool, typer.Option("--rgbd", help="The camera's frames too, about 1 GB a set.")] = False,
    every: Annotated[int, typer.Option("--every", min=1, metavar="K", help="With --rgbd: every K-th frame.")] = 1,
    base_url: Annotated[
        str | None, typer.Option("--base-url", metavar="URL", help="Take the files from a mirror.")
    ] = None,
    connections: Annotated[int, typer.Option("--connections", min=1, max=16, help="Downloads at a time.")] = 4,
    quiet: QuietOpt = False,
) -> None:
    """Download a public recording and check it against a pinned hash."""
    from pfslam_viz.commands import recordings as command

    command.run_fetch(name, data, rgbd, every, base_url, connections, quiet)


@app.command(
    rich_help_panel=RECORDINGS,
    epilog=examples("simulate recordings/office --seed 3", "simulate ring --building ring --duration 90"),
)
def simulate(
    out: Annotated[Path, typer.Argument(metavar="OUT", help="Folder to write, in the ECE276A layout.")],
    seed: Annotated[int, typer.Option("--seed", min=0, help="Same seed, same bytes.")] = 0,
    duration: Annotated[
        float | None,
        typer.Option("--duration", min=0, metavar="SECONDS", help="At most so long.  [dim]the whole route[/dim]"),
    ] = None,
    building: Annotated[
        str, typer.Option("--building", metavar="NAME", help="office, ring, hallway, campus; the seed varies it.")
    ] = "office",
    frames: Annotated[bool, typer.Option("--frames/--no-frames", help="Render the camera's frames.")] = True,
    scan_rate: Annotated[
        float | None, typer.Option("--scan-rate", metavar="HZ", help="Of the lidar.  [dim]40, as the real one's[/dim]")
    ] = None,
    wheel_scale: Annotated[
        float, typer.Option("--wheel-scale", min=0.5, max=1.5, help="Measured ÷ true wheel path: 1.03 is 3 % off.")
    ] = 1.0,
    slip: Annotated[float, typer.Option("--slip", min=0, max=0.5, help="Spread of the wheels' slip.")] = 0.01,
    gyro_bias: Annotated[
        float | None,
        typer.Option("--gyro-bias", metavar="RAD/S", help="The gyro's bias.  [dim]drawn, as measured[/dim]"),
    ] = None,
    camera_pitch: Annotated[
        float | None,
        typer.Option("--camera-pitch", metavar="DEG", help="True pitch.  [dim]as told[/dim]", rich_help_panel=CAMERA),
    ] = None,
    camera_roll: Annotated[
        float | None,
        typer.Option("--camera-roll", metavar="DEG", help="True roll.  [dim]as told[/dim]", rich_help_panel=CAMERA),
    ] = None,
    camera_height: Annotated[
        float | None,
        typer.Option(
            "--camera-height",
            metavar="M",
            help="True height.  [dim]as told[/dim]",
            rich_help_panel=CAMERA,
        ),
    ] = None,
    disparity_noise: Annotated[
        float, typer.Option("--disparity-noise", help="Spread in steps; a real one has 1.25.", rich_help_panel=CAMERA)
    ] = 0.0,
    disparity_holes: Annotated[
        float, typer.Option("--disparity-holes", help="Share; a real one has 0.01.", rich_help_panel=CAMERA)
    ] = 0.0,
    exposure_drift: Annotated[
        float, typer.Option("--exposure-drift", help="Brighter and darker by this share.", rich_help_panel=CAMERA)
    ] = 0.0,
    motion_blur: Annotated[
        float, typer.Option("--motion-blur", metavar="S", help="The shutter is open so long.", rich_help_panel=CAMERA)
    ] = 0.0,
) -> None:
    """Make a recording with known truth: a robot drives through a simulated building."""
    from pfslam_viz.commands import simulate as command
    from pfslam_viz.simulation.camera_errors import CameraErrors

    camera = CameraErrors(
        camera_pitch, camera_roll, camera_height, disparity_noise, disparity_holes, exposure_drift, motion_blur
    )
    command.run(out, seed, duration, building, frames, wheel_scale, slip, gyro_bias, camera, scan_rate)


@app.command(
    rich_help_panel=JUDGE,
    epilog=examples("evaluate demo", "evaluate intel --seeds 5 --json", "evaluate 21 --config my.toml"),
)
def evaluate(
    recording: RecordingArg,
    config: ConfigsOpt = None,
    settings: SetOpt = None,
    particles: ParticlesOpt = None,
    seeds: Annotated[
        int, typer.Option("--seeds", min=1, max=100, help="Runs of each configuration.", rich_help_panel=FILTER)
    ] = 1,
    paper: Annotated[
        bool, typer.Option("--paper/--no-paper", help="Run the paper's filter beside it.", rich_help_panel=FILTER)
    ] = True,
    data: DataOpt = None,
    robot: RobotOpt = None,
    start: StartOpt = 0,
    stop: StopOpt = None,
    stride: StrideOpt = 1,
    scan_topic: ScanTopicOpt = None,
    odom_topic: OdomTopicOpt = None,
    base_frame: BaseFrameOpt = None,
    force: ForceOpt = False,
    json: JsonOpt = False,
    quiet: QuietOpt = False,
) -> None:
    """Run and score: error against truth or relations if there are any, else the map's quality; and times."""
    from pfslam_viz.commands import evaluate as command
    from pfslam_viz.commands.choices import ConfigChoice, RecordingChoice

    command.run(
        RecordingChoice(recording, data, robot, start, stop, stride, scan_topic, odom_topic, base_frame, force),
        [ConfigChoice.parse(text, tuple(settings or ()), particles) for text in config or (None,)],
        seeds,
        paper,
        json,
        quiet,
    )


@app.command(
    rich_help_panel=JUDGE,
    epilog=examples(
        "sweep demo --config paper --set particles=50,100,500 --seeds 5 --out study",
        "sweep demo 21 --config paper --config default --seeds 3 --out study --scheduler tcp://10.0.0.1:8786",
        "sweep --plan sweep.toml --out study",
    ),
)
def sweep(
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder for the results; run again to go on.")],
    recording: Annotated[
        list[str] | None, typer.Argument(metavar="RECORDING...", help="Names or paths, one or more.")
    ] = None,
    config: ConfigsOpt = None,
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set", metavar="SECTION.KEY=A,B", help="Values of a setting. Repeatable.", rich_help_panel=FILTER
        ),
    ] = None,
    seeds: Annotated[
        int | None,
        typer.Option(
            "--seeds", min=1, max=1000, help="Runs of each combination.  [dim]1[/dim]", rich_help_panel=FILTER
        ),
    ] = None,
    plan: Annotated[
        Path | None, typer.Option("--plan", metavar="PATH", help="A TOML file that says the same; see docs/sweep.md.")
    ] = None,
    by: Annotated[
        str | None,
        typer.Option("--by", metavar="COLUMN", help="What ranks the runs.  [dim]error, else thickness of walls[/dim]"),
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option("--scheduler", metavar="tcp://HOST:8786", help="A Dask scheduler.  [dim]this machine[/dim]"),
    ] = None,
    workers: Annotated[
        int | None, typer.Option("--workers", min=1, help="Processes on this machine.  [dim]one a core[/dim]")
    ] = None,
    redo_old: Annotated[
        bool | None, typer.Option("--redo-old/--keep-old", help="What to do with runs of other code.")
    ] = None,
    viewer: Annotated[bool, typer.Option("--rrd/--no-rrd", help="Write sweep.rrd.")] = True,
    data: DataOpt = None,
    robot: RobotOpt = None,
    start: StartOpt = 0,
    stop: StopOpt = None,
    stride: StrideOpt = 1,
    scan_topic: ScanTopicOpt = None,
    odom_topic: OdomTopicOpt = None,
    base_frame: BaseFrameOpt = None,
    force: ForceOpt = False,
    quiet: QuietOpt = False,
) -> None:
    """Run every combination of recordings, configurations, settings and seeds, and rank them."""
    from pfslam_viz.commands import sweep as command
    from pfslam_viz.commands.choices import RecordingChoice

    command.run(
        recording or (),
        RecordingChoice("", data, robot, start, stop, stride, scan_topic, odom_topic, base_frame, force),
        command.SweepChoice(
            tuple(config or ()), tuple(settings or ()), seeds, plan, by, scheduler, workers, redo_old, viewer
        ),
        out,
        quiet,
    )


@app.command(
    rich_help_panel=RUN,
    epilog=examples(
        "compare 21 --config paper --config default --save compared.rrd",
        "compare demo --config paper,particles=50 --config paper --spawn",
    ),
)
def compare(
    recording: RecordingArg,
    config: ConfigsOpt = None,
    settings: SetOpt = None,
    particles: ParticlesOpt = None,
    seed: SeedOpt = None,
    save: SaveOpt = None,
    spawn: SpawnOpt = False,
    serve: ServeOpt = False,
    web: WebOpt = False,
    bind: BindOpt = "127.0.0.1",
    connect: ConnectOpt = None,
    stdout: StdoutOpt = False,
    data: DataOpt = None,
    robot: RobotOpt = None,
    start: StartOpt = 0,
    stop: StopOpt = None,
    stride: StrideOpt = 1,
    scan_topic: ScanTopicOpt = None,
    odom_topic: OdomTopicOpt = None,
    base_frame: BaseFrameOpt = None,
    force: ForceOpt = False,
    map_every: MapEveryOpt = None,
    max_particles: MaxParticlesOpt = None,
    max_beams: MaxBeamsOpt = None,
    quiet: QuietOpt = False,
) -> None:
    """Replay one recording under two or more configurations, side by side in one file."""
    from pfslam_viz.commands import compare as command
    from pfslam_viz.commands.choices import ConfigChoice, DetailChoice, RecordingChoice, SinkChoice

    command.run(
        RecordingChoice(recording, data, robot, start, stop, stride, scan_topic, odom_topic, base_frame, force),
        [ConfigChoice.parse(text, tuple(settings or ()), particles, seed) for text in config or ()],
        SinkChoice(save, spawn, serve, bind, connect, stdout, web),
        DetailChoice(map_every, max_particles, max_beams),
        quiet,
    )


@app.command(
    rich_help_panel=RUN,
    epilog=examples(
        "video demo.rrd demo.mp4",
        "video demo.rrd turn.gif --from 900 --to 1400 --width 800",
        "video demo.rrd end.png --view 3-D",
        "video compared.rrd fast.webm --speed 20 --size 1920x1080",
    ),
)
def video(
    recording: Annotated[Path, typer.Argument(metavar="RECORDING.rrd", help="What replay or compare saved.")],
    out: Annotated[Path, typer.Argument(metavar="OUT", help=".mp4, .webm, .gif or .webp; .png for a picture.")],
    view: Annotated[
        str, typer.Option("--view", metavar="NAME", help="The tab to show.", show_default=True)
    ] = "Compare",
    first: Annotated[int | None, typer.Option("--from", min=0, metavar="SCAN", help="First scan of the film.")] = None,
    last: Annotated[int | None, typer.Option("--to", min=0, metavar="SCAN", help="Last scan of the film.")] = None,
    speed: Annotated[
        float | None,
        typer.Option(
            "--speed",
            min=0.01,
            max=1e4,
            metavar="X",
            help="So many times as fast as the robot.  [dim]at most 15 s in all[/dim]",
        ),
    ] = None,
    step: Annotated[
        int | None, typer.Option("--step", min=0, metavar="SCAN", help="Of a picture: which scan.  [dim]the last[/dim]")
    ] = None,
    size: Annotated[
        str, typer.Option("--size", metavar="WxH", help="Of the view, in pixels.", show_default=True)
    ] = "1280x720",
    width: Annotated[
        int | None,
        typer.Option("--width", min=64, max=3840, metavar="PIXELS", help="Scale the pictures to this width."),
    ] = None,
    quiet: QuietOpt = False,
) -> None:
    """Make a film or a picture of a recording, as the viewer shows it; no screen is needed."""
    from pfslam_viz.commands import video as command

    command.run(recording, out, view, size, width, command.FilmChoice(first, last, speed, step), quiet)


@app.command(
    rich_help_panel=JUDGE, epilog=examples("figures 21 figures/", "figures demo figures/ --every 250 --config paper")
)
def figures(
    recording: RecordingArg,
    out: Annotated[Path, typer.Argument(metavar="OUT", help="Folder for the pictures and their index.html.")],
    every: Annotated[int, typer.Option("--every", min=1, metavar="K", help="Scans between pictures over time.")] = 500,
    config: ConfigOpt = None,
    settings: SetOpt = None,
    particles: ParticlesOpt = None,
    seed: SeedOpt = None,
    data: DataOpt = None,
    robot: RobotOpt = None,
    start: StartOpt = 0,
    stop: StopOpt = None,
    stride: StrideOpt = 1,
    scan_topic: ScanTopicOpt = None,
    odom_topic: OdomTopicOpt = None,
    base_frame: BaseFrameOpt = None,
    force: ForceOpt = False,
    quiet: QuietOpt = False,
) -> None:
    """Write the paper's figures as PNG, with an index.html that shows them in its order."""
    from pfslam_viz.commands import figures as command
    from pfslam_viz.commands.choices import ConfigChoice, RecordingChoice

    command.run(
        RecordingChoice(recording, data, robot, start, stop, stride, scan_topic, odom_topic, base_frame, force),
        ConfigChoice(config, tuple(settings or ()), particles, seed),
        out,
        every,
        quiet,
    )


@app.command("compile", rich_help_panel=RUN, epilog=examples("compile"))
def compile_kernels(quiet: QuietOpt = False) -> None:
    """Compile everything that a first run would, for images of containers and for clusters."""
    from pfslam_viz.commands import compile as command

    command.run(quiet)


@app.command(rich_help_panel=JUDGE, epilog=examples("config", "config paper --set particles=100 > mine.toml"))
def config(
    name: Annotated[
        str, typer.Argument(metavar="[NAME|PATH]", help="A shipped configuration or a TOML file.")
    ] = "default",
    settings: SetOpt = None,
    markdown: Annotated[bool, typer.Option("--markdown", help="The reference of all settings instead.")] = False,
) -> None:
    """Print every setting with value, range and meaning, as TOML that --config reads back."""
    from pfslam_viz.commands import config as command

    command.run(name, tuple(settings or ()), markdown)


def call(arguments: Sequence[str]) -> int:
    """Run one command line and return its exit status; errors become one line on stderr."""
    before, rest = _until_double_dash(arguments)
    debug = "--debug" in before  # accepted anywhere, also after the command
    message: str | None = None
    given = [argument for argument in before if argument != "--debug"] + rest
    try:
        _refuse_empty(given)
        status = app(given, prog_name=PROGRAM, standalone_mode=False)
    except KeyboardInterrupt:
        status, message = 130, "interrupted"
    except Exception as error:
        if debug:
            traceback.print_exc()
        status, message = _explain(error, debug)
    else:
        status = status if isinstance(status, int) else 0
        if status == 130:
            message = "interrupted"
    try:
        with streams.full_named():
            sys.stdout.flush()
    except PfslamError as error:
        status, message = status or error.exit_status, message or str(error)
    if debug and "pfslam_viz.compiling.cache" in sys.modules:
        with suppress(OSError):
            print(f"{PROGRAM}: {sys.modules['pfslam_viz.compiling.cache'].where()}", file=sys.stderr)
    if message:
        with suppress(OSError):  # nobody hears it
            print(f"{PROGRAM}: {readable(' '.join(message.split()))}", file=sys.stderr)
    return status


def _refuse_empty(arguments: Sequence[str]) -> None:
    """Raise InputError for an argument without a character, which as a path would mean the current folder."""
    for before, argument in pairwise(["", *arguments]):
        name, equals, value = argument.partition("=") if argument.startswith("--") else ("", "", argument)
        if (equals or not name) and not value.strip():
            what = name or (before if before.startswith("-") else "an argument")
            raise InputError(f"{what} is empty: is a variable of the shell not set? ('.' is the current folder)")


def _until_double_dash(arguments: Sequence[str]) -> tuple[list[str], list[str]]:
    at = list(arguments).index("--") if "--" in arguments else len(arguments)
    return list(arguments[:at]), list(arguments[at:])


def _explain(error: Exception, debug: bool) -> tuple[int, str | None]:
    """Exit status and message of an error that ended a command."""
    if isinstance(error, PfslamError):
        return error.exit_status, str(error)
    if isinstance(error, typer.Abort):
        return 130, "interrupted"
    describe: Any = getattr(error, "format_message", None)  # typer's own: wrong use
    if describe is not None:
        context = getattr(error, "ctx", None)
        path = context.command_path if context is not None else PROGRAM
        return 2, f"{describe()} (see {path} --help)" if describe() else None
    if isinstance(error, OSError) and error.strerror:
        name = f"{error.filename}: " if error.filename else ""
        return 1, f"{name}{error.strerror}"
    if isinstance(error, MemoryError) or (isinstance(error, ImportError) and "map segment" in str(error)):
        return 1, "out of memory"
    hint = "" if debug else "; --debug shows where"
    return 1, f"{type(error).__name__}: {error}{hint}"


def main() -> None:
    """Entry point. Exit status: 0 done, 1 failed while running, 2 wrong use or input, 130 interrupted."""
    streams.open_all()
    # The garbage collector has next to nothing to find here, and would walk all that was imported again and again.
    gc.set_threshold(500_000)
    # Threads of NumPy's and OpenCV's own cost more than they help with arrays of this size: they spin while they wait.
    for threads in ("OPENBLAS_NUM_THREADS", "OPENCV_FOR_THREADS_NUM"):
        os.environ.setdefault(threads, "1")
    # Numba's refusals while it compiles, which nobody reads, are not made colourful: a thirtieth of compiling.
    os.environ.setdefault("NUMBA_DISABLE_ERROR_MESSAGE_HIGHLIGHTING", "1")
    # What Rerun says of a file that it cannot write, or a viewer that is gone, we say ourselves, in one line.
    os.environ.setdefault("RUST_LOG", "warn,re_log_encoding=off,re_sdk=off,re_grpc_client=off")
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # a request to terminate is Ctrl-C: all is put in order
    # Pyarrow imports pandas with its first array, where it is installed. It would remember that it was refused: so only
    # here, where the process is our own.
    with spared("pandas"):
        status = call(sys.argv[1:])
    gc.freeze()  # nor as the interpreter ends, which would take half a second
    sys.exit(status)
