"""The options that several commands take, each written once, and the panels of ``--help`` that they stand in."""

from pathlib import Path
from typing import Annotated

import typer

# Panels of --help.
SINKS, FILTER, SCANS, DETAIL = "Where it goes", "The filter", "The recording", "Size and detail"
CAMERA = "The camera"
RUN, JUDGE, RECORDINGS = "Replay", "Judge", "Recordings"

RecordingArg = Annotated[
    str, typer.Argument(metavar="RECORDING", help="A name, such as demo, 21 or intel, or the path of a file or folder.")
]
DataOpt = Annotated[
    Path | None,
    typer.Option(
        "--data",
        metavar="DIR",
        help="Where recordings are looked up by name.  [dim]$PFSLAM_RECORDINGS, else recordings/[/dim]",
        rich_help_panel=SCANS,
    ),
]
RobotOpt = Annotated[
    str | None,
    typer.Option(
        "--robot",
        metavar="NAME|PATH",
        help="Robot file of an ECE276A set.  [dim]robot.toml beside it, else ece276a[/dim]",
        rich_help_panel=SCANS,
    ),
]
ScanTopicOpt = Annotated[
    str | None,
    typer.Option("--scan-topic", metavar="TOPIC", help="Of a ROS bag: which LaserScans.", rich_help_panel=SCANS),
]
OdomTopicOpt = Annotated[
    str | None,
    typer.Option("--odom-topic", metavar="TOPIC", help="Of a ROS bag: which odometry, or none.", rich_help_panel=SCANS),
]
BaseFrameOpt = Annotated[
    str | None,
    typer.Option("--base-frame", metavar="FRAME", help="Of a ROS bag: the robot's frame.", rich_help_panel=SCANS),
]
StartOpt = Annotated[int, typer.Option("--start", min=0, help="First scan.", rich_help_panel=SCANS)]
StopOpt = Annotated[int | None, typer.Option("--stop", min=1, help="Scan to stop before.", rich_help_panel=SCANS)]
StrideOpt = Annotated[int, typer.Option("--stride", min=1, help="Use every K-th scan.", rich_help_panel=SCANS)]
ForceOpt = Annotated[
    bool, typer.Option("--force", help="Replay it even if it was found to be wrong.", rich_help_panel=SCANS)
]
ConfigOpt = Annotated[
    str | None,
    typer.Option(
        "--config",
        metavar="NAME|PATH",
        help="A shipped configuration or a TOML file.  [dim]default[/dim]",
        rich_help_panel=FILTER,
    ),
]
ConfigsOpt = Annotated[
    list[str] | None,
    typer.Option(
        "--config",
        metavar="NAME|PATH[,KEY=VALUE]",
        help="A configuration, with settings of its own if wished: paper,particles=50. Repeatable.",
        rich_help_panel=FILTER,
    ),
]
SetOpt = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="SECTION.KEY=VALUE", help="Change one setting. Repeatable.", rich_help_panel=FILTER),
]
ParticlesOpt = Annotated[
    int | None, typer.Option("--particles", min=1, help="Number of particles.", rich_help_panel=FILTER)
]
SeedOpt = Annotated[
    int | None, typer.Option("--seed", min=0, help="Seed of the random numbers.", rich_help_panel=FILTER)
]
SaveOpt = Annotated[
    Path | None, typer.Option("--save", metavar="PATH", help="Write a .rrd file.", rich_help_panel=SINKS)
]
SpawnOpt = Annotated[bool, typer.Option("--spawn", help="Open the viewer and watch live.", rich_help_panel=SINKS)]
ServeOpt = Annotated[bool, typer.Option("--serve", help="Let viewers connect, on this machine.", rich_help_panel=SINKS)]
WebOpt = Annotated[
    bool,
    typer.Option("--web", help="With --serve: the web viewer too, for a browser here.", rich_help_panel=SINKS),
]
BindOpt = Annotated[
    str,
    typer.Option(
        "--bind", metavar="ADDRESS", help="Address that --serve listens on.", rich_help_panel=SINKS, show_default=True
    ),
]
ConnectOpt = Annotated[
    str | None,
    typer.Option(
        "--connect",
        metavar="URL",
        help="Send to a viewer that runs already: rerun+http://127.0.0.1:9876/proxy",
        rich_help_panel=SINKS,
    ),
]
StdoutOpt = Annotated[bool, typer.Option("--stdout", help="Write the .rrd to standard output.", rich_help_panel=SINKS)]
MapEveryOpt = Annotated[
    int | None,
    typer.Option(
        "--map-every",
        min=1,
        help="Log the maps every K scans.  [dim]about 200 maps a recording[/dim]",
        rich_help_panel=DETAIL,
    ),
]
MaxParticlesOpt = Annotated[
    int | None,
    typer.Option(
        "--max-particles",
        min=1,
        help="Log at most so many.  [dim]500, fewer in long recordings[/dim]",
        rich_help_panel=DETAIL,
    ),
]
MaxBeamsOpt = Annotated[
    int | None,
    typer.Option(
        "--max-beams",
        min=1,
        help="Log at most so many end points.  [dim]270, fewer in long ones[/dim]",
        rich_help_panel=DETAIL,
    ),
]
QuietOpt = Annotated[bool, typer.Option("--quiet", "-q", help="No progress bar and no summary.")]
JsonOpt = Annotated[bool, typer.Option("--json", help="Print JSON.")]
