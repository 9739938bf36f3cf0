"""The table of what a recording shows, a row for each entity.

Styles, the help page and the layout read the table; to add an entity, add its row and fill it with data in
:mod:`pfslam_viz.viewer.drawing` or :mod:`pfslam_viz.viewer.collector` (docs/adding.md has the steps).
"""

from dataclasses import dataclass
from enum import Enum, auto
from typing import Literal

from pfslam_viz.viewer.colors import DEAD_RECKONING, DOUBT, HINDSIGHT, HIT, INK, LINEAGE, MISS, TRUTH, WALL, Color

MAP_Z, TEXTURE_Z, LIDAR_Z, PARTICLE_Z, TRAIL_Z, TRUTH_Z, MARK_Z, POSE_Z = 0.0, 0.01, 0.03, 0.04, 0.06, 0.07, 0.08, 0.09
"""Heights (m) that keep the layers of a flat scene from hiding each other."""

ONLY_RUN = "filter"
"""What the run is called where it is the recording's only one."""

OVERVIEW = "world/overview"
"""The pinhole that looks down on the whole map."""

HELP, ABOUT, LEGEND, FILTER_LEGEND = "help", "about", "legend", "filter_legend"
"""The pages: what each entity is; recording, result, configuration and versions; the colours, beside the maps and
beside the curves of the tab Filter."""

SCALE_BAR = "world/scale_bar"
"""A line of round length in the corner of the overview; what follows the robot has such lines of its own."""

ERROR_SCALE = "world/error_scale"
"""The colours of errors, at the right of the overview."""


class Kind(Enum):
    """What an entity consists of, which decides its static style (:mod:`pfslam_viz.viewer.style`)."""

    POINTS = auto()
    LINES = auto()
    ARROWS = auto()
    BOXES = auto()
    DOT = auto()  # one point, moved by transforms
    ELLIPSE = auto()  # a unit circle, moved and stretched by transforms
    ROBOT = auto()  # an arrow head, moved by transforms
    TRAIL = auto()  # a growing trajectory in three entities: pfslam_viz.viewer.trail
    GRID = auto()  # cells on the floor: a map or a texture
    CAMERA = auto()  # a pinhole in the scene and its image
    IMAGE = auto()  # an image by itself
    FRAME = auto()  # a coordinate frame that other entities hang on; not visible
    CURVE = auto()  # numbers in a plot
    EVENTS = auto()  # a list of sentences
    MARKS = auto()  # single numbers in a plot, a dot each


class View(Enum):
    """The views that show entities: spatial ones, images, and the rows of plots below three tabs."""

    COMPARE = auto()  # the maps side by side: dead reckoning's, and each run's
    CLOSE_UP = auto()  # a few metres round the robot
    LOUPE = auto()  # the particles
    TEXTURE = auto()
    THREE_D = auto()
    ERROR = auto()  # the maps side by side, trajectories coloured by error
    COLOR_CAMERA = auto()
    DEPTH_CAMERA = auto()
    COMPARE_PLOTS = auto()
    FILTER_PLOTS = auto()
    ERROR_PLOTS = auto()
    EVENTS = auto()


@dataclass(frozen=True, slots=True)
class Entity:
    """A row of the table.

    Attributes:
        template: entity path; ``{run}`` stands for the run's name in what each run has of its own.
        kind: what it consists of.
        help: what the help page says of it, ``{color}`` being the colour's name; an invisible entity has none.
        color: its static colour: a fixed one, or "run" for the run's. None where the data bring their own.
        width: radius of its points or lines, width of its curve, in pixels of the viewer's interface (ui points).
        z: height in m that it is drawn at.
        few: the same as ``width`` where particles are few, which would hardly show otherwise; 0: no other.
        views: the views that contain it.
        title: of the plot, for a curve that is a plot's first.
        keep: which of the scans that share a pixel a curve shows: Rerun's aggregation policy. An average would hide
            the lows, or the highs, that the curve is looked at for.
    """

    template: str
    kind: Kind
    help: str = ""
    color: Color | Literal["run"] | None = None
    width: float = 0.0
    z: float = 0.0
    few: float = 0.0
    views: tuple[View, ...] = ()
    title: str = ""
    keep: Literal["Average", "Min", "Max"] = "Average"

    def path(self, run: str) -> str:
        """Its entity path in a run, whose name does not matter where the entity is shared."""
        return self.template.format(run=run)

    def visible(self, run: str) -> tuple[str, ...]:
        """The entity paths that carry what is visible of it: parts of it, or itself."""
        parts = {Kind.TRAIL: ("/done", "/between", "/open"), Kind.ROBOT: ("/shape", "/outline")}.get(self.kind, ("",))
        return tuple(self.path(run) + part for part in parts)

    @property
    def owner(self) -> str:
        """``{run}`` for what each run has of its own, else ``dead_reckoning`` or ``truth``."""
        parts = self.template.split("/")
        return next(part for part in ("{run}", "dead_reckoning", "truth") if part in parts)

    @property
    def plot(self) -> str:
        """A curve's plot."""
        return self.template.split("/")[1]

    def rgb(self, run_color: Color) -> Color | None:
        """Its static colour in a run of this colour."""
        return run_color if self.color == "run" else self.color


_OVERVIEWS = (View.COMPARE, View.ERROR)
_MAPS = (View.COMPARE, View.CLOSE_UP, View.LOUPE, View.TEXTURE, View.THREE_D)
_SCANS = (View.COMPARE, View.CLOSE_UP, View.LOUPE, View.THREE_D)
_NEAR = (View.CLOSE_UP, View.LOUPE)

# fmt: off
# What each run has of its own: in the order of the help page.
MAP = Entity("world/{run}/map", Kind.GRID, z=MAP_Z, views=(*_MAPS, View.ERROR),
    help="the filter's map: white is free, black occupied, grey-green unknown, nearly white a narrow gap between rays")
WALLS = Entity("world/{run}/walls", Kind.BOXES, color=WALL, views=(View.THREE_D,),
    help="in 3-D: the occupied cells, raised (a drawing; the lidar sees one height)")
PARTICLES = Entity("world/{run}/particles", Kind.POINTS, width=2.0, few=3.5, z=PARTICLE_Z, views=_SCANS,
    help="every particle, from yellow (no weight) over green (an average one) to dark violet (ten times that)")
HEADINGS = Entity("world/{run}/headings", Kind.ARROWS, width=0.75, few=1.5, z=PARTICLE_Z, views=(View.LOUPE,),
    help="where some of the particles look, in the same colours")
SCAN_HIT = Entity("world/{run}/scan/hit", Kind.POINTS, color=HIT, width=1.75, z=LIDAR_Z, views=_SCANS,
    help="{color}: lidar end points on a cell that the map already held occupied")
SCAN_MISS = Entity("world/{run}/scan/miss", Kind.POINTS, color=MISS, width=1.75, z=LIDAR_Z, views=_SCANS,
    help="{color}: lidar end points where the map held no wall")
ROBOT = Entity("world/{run}/robot", Kind.ROBOT, color="run", width=1.5, z=POSE_Z,
    views=(*_OVERVIEWS, View.CLOSE_UP, View.TEXTURE, View.THREE_D),
    help="{color} arrow: the best particle's pose")
TRAJECTORY = Entity("world/{run}/trajectory", Kind.TRAIL, color="run", width=1.75, z=TRAIL_Z, views=_MAPS,
    help="{color}: the best particle at every scan, as it was estimated then")
MEAN = Entity("world/{run}/mean", Kind.DOT, color="run", width=4.0, z=POSE_Z, views=_NEAR,
    help="{color} dot: the weighted mean of the particles")
COVARIANCE = Entity("world/{run}/covariance", Kind.ELLIPSE, color="run", width=1.25, z=POSE_Z,
    views=(View.COMPARE, *_NEAR),
    help="{color} ellipse: two standard deviations about the mean")
LINEAGES = Entity("world/{run}/lineages", Kind.LINES, color=LINEAGE, width=0.5, z=LIDAR_Z, views=(View.LOUPE,),
    help="{color}: the ancestors that today's particles still have")
HINDSIGHT_TRAJECTORY = Entity("world/{run}/hindsight", Kind.LINES, color=HINDSIGHT, width=1.5, z=TRAIL_Z,
    views=(View.COMPARE, View.THREE_D),
    help="{color}, in the last step: the whole trajectory as known at the end, in hindsight")
CORRECTION = Entity("world/{run}/correction", Kind.ARROWS, color=MISS, width=1.5, z=POSE_Z, views=(View.LOUPE,),
    help="{color} arrow: what scan matching moved the pose by, ten times as long")
DEGENERATE = Entity("world/{run}/degenerate", Kind.LINES, color=MISS, width=1.5, z=POSE_Z, views=_NEAR,
    help="{color} line: the direction in which this scan cannot place the robot")
CLOSURES = Entity("world/{run}/closures", Kind.LINES, color=HINDSIGHT, width=1.5, z=POSE_Z,
    views=(View.COMPARE, View.CLOSE_UP, View.THREE_D),
    help="{color}: pairs of scans recognised as the same place, at the last step")
ERROR_TRAJECTORY = Entity("world/{run}/error", Kind.TRAIL, width=2.5, z=TRAIL_Z, views=(View.ERROR,),
    help="the best particle at every scan, by its distance from the truth then: light blue (under 2 cm) over violet to"
    " dark red (over 1 m)")
SETTLED_ERROR = Entity("world/{run}/settled_error", Kind.LINES, width=2.5, z=POSE_Z, views=(View.ERROR,),
    help="in the last step: the same of the trajectory as known at the end")
RESAMPLED_AT = Entity("world/{run}/marks/resampled", Kind.POINTS, color=MISS, width=2.0, z=MARK_Z,
    views=(View.COMPARE, View.CLOSE_UP, View.THREE_D),
    help="{color} dots on the trajectory: where particles were resampled; one of several that are close together")
DOUBTED_AT = Entity("world/{run}/marks/doubt", Kind.POINTS, color=DOUBT, width=4.0, z=POSE_Z,
    views=(View.COMPARE, View.CLOSE_UP, View.THREE_D),
    help="{color} dots: where the robot was when something was to be doubted (WARN in the list of events)")
CLOSED_AT = Entity("world/{run}/marks/loop", Kind.POINTS, color=HINDSIGHT, width=4.0, z=POSE_Z,
    views=(View.COMPARE, View.CLOSE_UP, View.THREE_D), help="{color} dots: where a loop was closed")
NEWEST = Entity("world/{run}/marks/newest", Kind.POINTS, color=INK, width=1.5, z=POSE_Z,
    views=(View.COMPARE,), help="{color}: in the newest of these dots, for a while, what happened there")
TEXTURE = Entity("world/{run}/texture", Kind.GRID, z=TEXTURE_Z, views=(View.TEXTURE, View.THREE_D),
    help="the floor's colours as the camera saw them, over the map")
COLOR_IMAGE = Entity("world/{run}/robot/camera", Kind.CAMERA, color="run", views=(View.COLOR_CAMERA, View.THREE_D),
    help="the colour image of the moment, where the camera is")
DISPARITY_IMAGE = Entity("camera/{run}/disparity", Kind.IMAGE, views=(View.DEPTH_CAMERA,),
    help="the depth image of the moment: bright is near, black is no depth")
EVENTS = Entity("events/{run}", Kind.EVENTS, views=(View.EVENTS,),
    help="what happened, by scan: resampled (DEBUG, hidden at first), loops closed, map and trajectory settled in"
    " hindsight, texture painted anew (INFO), and what to doubt (WARN): a corridor whose scans do not tell how far"
    " along the robot is, scans without match, odometry that is unknown, silent sensors")
FOLLOW = Entity("world/{run}/follow", Kind.FRAME)  # moves with the robot; the cameras of its own views hang on it

# What all runs share.
RECKONED_MAP = Entity("world/dead_reckoning/map", Kind.GRID, z=MAP_Z, views=_OVERVIEWS,
    help="the map that the same scans make from odometry alone")
RECKONED_SCAN = Entity("world/dead_reckoning/scan", Kind.POINTS, color=DEAD_RECKONING, width=1.75, z=LIDAR_Z,
    views=(View.COMPARE,), help="{color}: the lidar's end points from the dead-reckoned pose")
RECKONED_ROBOT = Entity("world/dead_reckoning/robot", Kind.ROBOT, color=DEAD_RECKONING, width=1.5, z=POSE_Z,
    views=(*_OVERVIEWS, View.THREE_D), help="{color} arrow: the dead-reckoned pose")
RECKONED_TRAJECTORY = Entity("world/dead_reckoning/trajectory", Kind.TRAIL, color=DEAD_RECKONING, width=1.75,
    z=TRAIL_Z, views=(View.COMPARE, View.THREE_D), help="{color}: where odometry alone leads")
RECKONED_ERROR_TRAJECTORY = Entity("world/dead_reckoning/error", Kind.TRAIL, width=2.5, z=TRAIL_Z, views=(View.ERROR,),
    help="dead reckoning at every scan, by its distance from the truth, in the same colours")
OUT_OF_VIEW = Entity("world/dead_reckoning/out_of_view", Kind.ARROWS, color=DEAD_RECKONING, width=4.0, z=POSE_Z,
    views=_OVERVIEWS,
    help="{color} arrow at the edge, from the end of a run on: dead reckoning is out of view, so far beyond the edge")
TRUE_ROBOT = Entity("world/truth/robot", Kind.ROBOT, color=TRUTH, width=1.5, z=POSE_Z,
    help="{color} arrow: the true pose")
TRUE_TRAJECTORY = Entity("world/truth/trajectory", Kind.TRAIL, color=TRUTH, width=0.75, z=TRUTH_Z,  # on the estimates
    views=_SCANS, help="{color}, thin: where the robot truly went")

# Curves, a plot being named by the middle of the path: in the order of the plots.
DRIFT = Entity("plots/drift/{run}", Kind.CURVE, color="run", width=1.5, views=(View.COMPARE_PLOTS,),
    title="Drift (m)", help="m between dead reckoning and the filter")
ERROR = Entity("plots/error/{run}", Kind.CURVE, color="run", width=1.5, views=(View.COMPARE_PLOTS, View.ERROR_PLOTS),
    title="Error (m)", keep="Max",
    help="m from the filter's pose, as it was estimated then, to the truth")
RECKONED_ERROR = Entity("plots/error/dead_reckoning", Kind.CURVE, color=DEAD_RECKONING, width=1.5,
    views=(View.COMPARE_PLOTS,), keep="Max", help="m from dead reckoning to the truth")
CORRELATION = Entity("plots/correlation/{run}", Kind.CURVE, color="run", width=1.5, views=(View.FILTER_PLOTS,),
    title="End points on walls", keep="Min",
    help="share of the end points that fall on occupied cells, the map's walls")
N_EFF = Entity("plots/n_eff/{run}", Kind.CURVE, color="run", width=1.5, views=(View.COMPARE_PLOTS, View.FILTER_PLOTS),
    title="N_eff", keep="Min",
    help="effective number of particles, 1 / Σ w²: the lowest of the scans that share a pixel")
N_EFF_LIMIT = Entity("plots/n_eff/{run}/threshold", Kind.CURVE, color=MISS, width=1.0,
    views=(View.COMPARE_PLOTS, View.FILTER_PLOTS), help="{color} line: below this N_eff, particles are resampled")
RESAMPLED = Entity("plots/n_eff/{run}/resampled", Kind.MARKS, color=MISS, width=1.5,
    views=(View.COMPARE_PLOTS, View.FILTER_PLOTS),
    help="{color} dots at the bottom: the particles were resampled after this scan")
SPREAD = Entity("plots/spread/{run}", Kind.CURVE, color="run", width=1.5, views=(View.COMPARE_PLOTS,),
    title="Spread (m)", keep="Max",
    help="m: standard deviation of the particles' positions")
SURVIVORS = Entity("plots/lineages/{run}", Kind.CURVE, color="run", width=1.5, views=(View.FILTER_PLOTS,),
    title="Surviving lineages", keep="Min",
    help="distinct ancestors since all particles last shared one")
HEADING_DRIFT = Entity("plots/heading_drift/{run}", Kind.CURVE, color="run", width=1.5, views=(View.FILTER_PLOTS,),
    title="Heading drift (°)",
    help="degrees, counter-clockwise, that dead reckoning has turned further than the filter: 400 is once round and 40")
SCORE = Entity("plots/score/{run}", Kind.CURVE, color="run", width=1.5, keep="Min",
    help="mean agreement of the matched scan with the map, 0 to 1")
CORRECTION_LENGTH = Entity("plots/correction/{run}", Kind.CURVE, color="run", width=1.5, keep="Max",
    help="m that scan matching moved the pose")
# fmt: on

ENTITIES: tuple[Entity, ...] = tuple(value for value in list(globals().values()) if isinstance(value, Entity))
"""The table: every row above, in their order."""

RUN_CURVES: dict[str, Entity] = {
    row.plot: row for row in ENTITIES if row.kind is Kind.CURVE and row.template.endswith("/{run}")
}
"""The curves that each run has, by plot."""
