"""The settings of matching key scans, smoothing the pose graph, closing loops, and judging what came of it."""

from typing import Annotated

from pydantic import Field

from pfslam_viz.settings import Config, Section, setting

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Hop = Annotated[int, Field(ge=1)]


class ScanMatchingConfig(Section):
    """Point-to-line ICP between two scans (Censi 2008)."""

    most_points: int = setting(400, "end points of a scan that are kept, evenly ...", ge=10)
    sparse: float = setting(0.08, "... and all that are as far as this from the one before", "m", gt=0)
    wall_reach: float = setting(0.3, "neighbours this near tell a wall's direction ...", "m", gt=0)
    wall_spacings: float = setting(
        3.0, "... or so many times the distance between neighbouring beams there, if that is more", gt=0
    )
    wall_neighbours: int = setting(20, "neighbours to either side that tell it, at most", ge=1, le=1000)
    wall_flatness: float = setting(
        0.1, "neighbours are a wall if the smaller eigenvalue of their spread is at most this share of the larger",
        gt=0, le=1,
    )  # fmt: skip
    shared_scans: int = setting(
        12, "key scans before and after one that tell with it where its walls lead, once their poses are known", ge=0
    )
    shared_reach: float = setting(0.15, "their end points this near tell it ...", "m", gt=0)
    fewest_shared: int = setting(8, "... if there are so many", ge=3)
    noise: float = setting(0.02, "standard deviation of an end point off its wall", "m", gt=0)
    robust_noise: float = setting(2.0, "an end point loses its say beyond so many standard deviations ...", gt=0)
    robust_gate: float = setting(3.0, "... or beyond the greatest distance over this, whichever is more", gt=0)
    facing: float = setting(0.7, "least cosine between the normals of two walls that may be one", ge=-1, lt=1)
    fewest_points: int = setting(5, "scans, and pairs of end points, fewer than this are not matched", ge=3)
    open_noise: float = setting(
        8.0, "a direction is left to the odometry if the scans have less of their information on it than so many times "
        "the variance of their walls' normals ...", ge=0
    )  # fmt: skip
    open_least: float = setting(0.001, "... but at least this share", ge=0, lt=0.5)
    open_share: float = setting(0.03, "... and at most this", ge=0, lt=0.5)
    settled_distance: float = setting(5e-4, "iterations stop when the pose moves by less ...", "m", gt=0)
    settled_angle: float = setting(3e-4, "... and turns by less", "rad", gt=0)


class SmoothingConfig(Section):
    """The pose graph over the key scans, which settles the whole trajectory in hindsight."""

    enabled: bool = setting(True, "settle the trajectory and redraw the map when all scans are in")
    rounds: int = setting(3, "times that neighbours are matched and the graph is relaxed", ge=2, le=20)
    hops: tuple[Hop, ...] = setting((1, 2, 4, 8), "key scans ahead that every key scan is matched with", min_length=1)
    radius: float = setting(2.0, "key scans of earlier visits this near are neighbours", "m", gt=0)
    neighbours: int = setting(3, "earlier visits that a key scan is matched with, at most", ge=0)
    apart: int = setting(30, "key scans between two visits, at least", ge=1)
    turn_length: float = setting(0.7, "what a rad of heading counts as when the nearest visit is looked for", "m", ge=0)
    match_points: int = setting(180, "end points of a scan that are matched, about", ge=10)
    first_gates: tuple[Positive, ...] = setting(
        (0.5, 0.3, 0.2, 0.1), "greatest distance of matched end points, iteration after iteration, at first", "m",
        min_length=1,
    )  # fmt: skip
    gates: tuple[Positive, ...] = setting((0.2, 0.1), "the same once the graph has settled", "m", min_length=1)
    match_iterations: int = setting(8, "of a match, at most", ge=1, le=100)
    guess_distance: float = setting(0.1, "standard deviation of the position that a match starts from", "m", gt=0)
    guess_angle: float = setting(0.05, "standard deviation of the heading that a match starts from", "rad", gt=0)
    overlap: float = setting(0.3, "share of matched end points below which a match is refused", ge=0, le=1)
    distance: float = setting(0.05, "mean distance from the walls above which a match is refused", "m", gt=0)
    longest_shift: float = setting(0.4, "a match that moves its guess farther is refused", "m", gt=0)
    largest_turn: float = setting(0.2, "a match that turns its guess farther is refused", "rad", gt=0)
    temper: float = setting(0.1, "exponent of a match's likelihood: end points are not independent", gt=0, le=1)
    noise_distance: float = setting(0.1, "odometry: m of error per m driven", gt=0)
    noise_angle: float = setting(0.2, "odometry: rad of error per rad turned", gt=0)
    noise_drift: float = setting(0.05, "odometry: rad of error per m driven", "rad/m", gt=0)
    least: float = setting(0.01, "odometry: error at least", "m and rad", gt=0)
    scale: float = setting(5.0, "standard deviations beyond which a constraint loses its say", gt=0)
    iterations: int = setting(8, "of relaxing the graph, at most", ge=1, le=100)
    settled_distance: float = setting(5e-4, "relaxing stops when no pose moves by more ...", "m", gt=0)
    settled_angle: float = setting(1e-4, "... or turns by more", "rad", gt=0)


class FilterConstraintsConfig(Section):
    """The filter's own increments between key scans, as robust constraints of the pose graph."""

    least_angle: float = setting(0.005, "error of the heading at least ...", "rad", gt=0)
    noise_angle: float = setting(0.02, "... and so much more per rad turned", gt=0)
    spans: tuple[Hop, ...] = setting((30,), "key scans over which its heading is held, if the scans prefer that")
    span_angle: float = setting(0.001, "error of the heading over such a span", "rad", gt=0)
    sure: float = setting(3.0, "standard errors from which they do", ge=0)
    least_distance: float = setting(0.1, "error of the position across walls at least ...", "m", gt=0)
    noise_distance: float = setting(0.05, "... and so much more per m driven", gt=0)
    least_share: float = setting(0.1, "share of the walls below which an increment says nothing along them", ge=0, lt=1)
    fewest_walls: int = setting(10, "end points on walls that a scan needs to say anything", ge=1)


class OdometryConfig(Section):
    """How far the odometry is to be believed, found out from what the scans say of the same motion."""

    memory: int = setting(200, "motions that are remembered while driving", ge=1)
    prior_motions: int = setting(20, "motions that the noise in the settings counts as", ge=1)
    least_noise: float = setting(0.1, "times the noise in the settings, at least", gt=0)
    most_noise: float = setting(1.5, "times the noise in the settings, at most", gt=0)
    scale_driven: float = setting(0.05, "a motion this long tells the wheels' scale ...", "m", gt=0)
    scale_known: float = setting(0.05, "... if the scans know every direction by this share", ge=0, lt=0.5)
    scale_motions: int = setting(20, "motions that have to tell it", ge=1)
    largest_scale: float = setting(1.25, "a scale above this, or below its inverse, is not believed", gt=1)
    proven: float = setting(
        0.2,
        "times the noise in the settings under which odometry is proven, over spans of one key scan to ...",
        ge=0,
        le=1,
    )
    proven_span: int = setting(16, "... so many: in most that are longer, the trajectory itself may be wrong", ge=1)
    proven_motions: int = setting(60, "motions between key scans that have to tell it", ge=8)
    proven_least: float = setting(
        0.02,
        "times the noise in the settings, at least, that proven odometry is taken to have; "
        "where scans were matched wrongly, its heading is held so firmly between matches, too",
        gt=0,
    )
    doubt: float = setting(
        5.0, "proven odometry's standard deviations beyond which a step of the trajectory is doubted ...", gt=0
    )
    doubt_distance: float = setting(0.15, "... if it is at least so far off ...", "m", ge=0)
    doubt_angle: float = setting(0.03, "... or so much", "rad", ge=0)
    doubt_hops: int = setting(4, "key scans this near to either side of such a step, or nearer, are asked ...", ge=1)
    doubt_refuted: float = setting(
        0.1,
        "... and if so much more of their end points agree with it than with the odometry, that slipped there",
        ge=0,
    )
    overruled: float = setting(
        2.0, "standard errors from which the scans' word for such steps counts more than proven odometry's", ge=0
    )


class LoopClosingConfig(Section):
    """When the key scans are believed to show a place that the trajectory has drifted away from."""

    enabled: bool = setting(True, "look for loops that the particles missed")
    searches: int = setting(3, "rounds of searching: a closed loop can bring others within reach", ge=1, le=20)
    every: int = setting(5, "key scans from one that is looked at to the next", ge=1)
    least_loop: float = setting(10.0, "driven since a place before it is looked for", "m", gt=0)
    places: int = setting(4, "earlier places that are looked at for one key scan, at most", ge=1)
    elsewhere: float = setting(6.0, "along the path from one earlier place that may be the one to the next", "m", gt=0)
    sigmas: float = setting(3.0, "standard deviations of the drift within which a place is looked for", gt=0)
    least_reach: float = setting(1.0, "searched round about at least ...", "m", gt=0)
    most_reach: float = setting(15.0, "... and at most", "m", gt=0)
    least_turn: float = setting(0.18, "searched to either side at least ...", "rad", gt=0)
    most_turn: float = setting(0.5, "... and at most", "rad", gt=0)
    turn_step: float = setting(0.03, "of the search", "rad", gt=0)
    cell: float = setting(0.1, "step of the search, and edge of a cell of the map that is searched", "m", gt=0)
    blur: float = setting(0.12, "how far from a wall an end point still counts", "m", gt=0)
    view: float = setting(12.0, "round a place that its map covers", "m", gt=0)
    around: float = setting(
        2.5, "along the path before and after, from where key scans are put together to one view", "m", gt=0
    )
    view_scans: int = setting(9, "key scans in one view, at most", ge=1)
    points: int = setting(300, "end points of a view that are laid over the map, about", ge=10)
    fits_already: float = setting(0.8, "mean agreement from which two views need not be searched", gt=0, le=1)
    score: float = setting(0.55, "mean agreement below which a fit is refused", gt=0, le=1)
    rival: float = setting(0.85, "share of the best fit's score that no other place may reach", gt=0, le=1)
    rival_distance: float = setting(0.7, "from the best fit, where another place begins", "m", gt=0)
    gates: tuple[Positive, ...] = setting(
        (0.5, 0.3, 0.2, 0.1), "of the scan match that confirms a fit, iteration after iteration", "m", min_length=1
    )
    guess_distance: float = setting(0.3, "standard deviation of the position that it starts from", "m", gt=0)
    guess_angle: float = setting(0.1, "standard deviation of the heading that it starts from", "rad", gt=0)
    match_stride: int = setting(2, "every so many end points are matched", ge=1)
    match_iterations: int = setting(15, "of a match, at most", ge=1, le=100)
    overlap: float = setting(0.4, "share of matched end points below which a fit is refused", ge=0, le=1)
    distance: float = setting(0.03, "mean distance from the walls above which a fit is refused", "m", gt=0)
    longest_shift: float = setting(0.5, "a match that moves the fit farther refuses it", "m", gt=0)
    largest_turn: float = setting(0.15, "a match that turns the fit farther refuses it", "rad", gt=0)
    confirm_within: int = setting(40, "key scans within which another closure must confirm one", ge=1)
    confirm_distance: float = setting(0.3, "by how much the two may disagree on the position", "m", gt=0)
    confirm_angle: float = setting(0.1, "by how much the two may disagree on the heading", "rad", gt=0)
    temper: float = setting(0.1, "exponent of a closure's likelihood", gt=0, le=1)
    sound: float = setting(
        0.5, "robust weight above which a match holds while the graph is pulled together", ge=0, lt=1
    )
    gain: float = setting(5.0, "matches by which the graph must agree better with a loop closed", ge=0)


class DriftConfig(Section):
    """How far key scans may have drifted apart: where loops are looked for."""

    links: int = setting(100, "matched visits and closed loops that are tried as short cuts, at most", ge=1)
    triangles: int = setting(
        30, "matches over two hops and over each that tell how precise matches are, at least", ge=1
    )
    caution: float = setting(
        2.0, "how much worse matches may be than they disagree: errors that are alike do not show", gt=0
    )
    least_distance: float = setting(0.003, "standard deviation of a match at least", "m", gt=0)
    least_angle: float = setting(0.001, "standard deviation of a match at least", "rad", gt=0)
    usual_distance: float = setting(0.01, "standard deviation of a match where too few tell it", "m", gt=0)
    usual_angle: float = setting(0.005, "standard deviation of a match where too few tell it", "rad", gt=0)


class EvidenceConfig(Section):
    """Which of two trajectories the scans speak for, by pairs of scans that were not matched with each other."""

    hops: tuple[Hop, ...] = setting((3, 6, 12, 24), "key scans ahead that every key scan is laid over", min_length=1)
    radius: float = setting(3.0, "key scans of earlier visits this near are laid over each other", "m", gt=0)
    apart: int = setting(30, "key scans between two visits, at least", ge=1)
    visits: int = setting(4, "earlier visits that a key scan is laid over, at most", ge=0)
    aside: int = setting(1, "key scans beside the nearest one of a visit, which was matched", ge=0)
    turn_length: float = setting(0.7, "what a rad of heading counts as when the nearest visit is looked for", "m", ge=0)
    beams: int = setting(90, "end points of a scan that are looked at, about", ge=10)
    fewest_points: int = setting(5, "scans with fewer end points say nothing", ge=3)
    gap: float = setting(3.0, "beams apart by so many times the mean have something in between", gt=0)
    sigma: float = setting(0.05, "spread of end points about a wall", "m", gt=0)
    wall_sigmas: float = setting(4.0, "standard deviations from a wall within which an end point may be on it", gt=0)
    wall_reach: float = setting(0.5, "a wall goes on for so far from its end point", "m", gt=0)
    margin: float = setting(0.25, "before the end of a beam, from which it has crossed a point ...", "m", ge=0)
    margin_share: float = setting(0.03, "... and so much more per m of range", ge=0)
    crossed: float = setting(1.0, "what an end point in the open speaks against, one on a wall for with 1", ge=0)
    alike_distance: float = setting(0.002, "a pair that both trajectories put alike to so much ...", "m", ge=0)
    alike_angle: float = setting(0.0005, "... and so much says nothing", "rad", ge=0)
    least_told: float = setting(0.1, "share of end points with something to say from which a pair counts", ge=0, le=1)
    block: int = setting(20, "successive key scans, whose evidence is not independent", ge=1)
    fewest_blocks: int = setting(4, "of them, which are shorter on a way that has not so many", ge=2)
    sure: float = setting(1.0, "standard errors from which a loop is closed on their word", ge=0)
    preferred: float = setting(0.25, "standard errors from which the settled trajectory is kept, which knows more")


class SlidingConfig(Section):
    """Where along a corridor two visits are, if their match leaves that open: free space may tell."""

    enabled: bool = setting(True, "lay visits over each other along a direction that their match leaves open")
    every: int = setting(3, "key scans from one that is looked at to the next", ge=1)
    weak: float = setting(
        0.05, "a direction of which a match knows less than this share of the other's may be open", gt=0, lt=1
    )
    reach: float = setting(1.2, "looked so far to either side", "m", gt=0)
    step: float = setting(0.1, "of the shifts that are tried", "m", gt=0)
    gain: float = setting(0.1, "share of end points that a shift explains more than any other, at least ...", gt=0)
    apart: float = setting(0.25, "... of those further from it than this", "m", gt=0)
    near: float = setting(0.2, "a match that is moved farther is a loop to be closed", "m", gt=0)
    deviation: float = setting(0.05, "standard deviation of what is found", "m", gt=0)


class RevisionConfig(Section):
    """Closing loops and settling the trajectory while the robot drives: every particle then goes on from there."""

    enabled: bool = setting(True, "revise the trajectory and the maps on the way")
    every: int = setting(5, "key scans from one look for a reason to the next", ge=1)
    shift: float = setting(0.03, "visits that do not match by so much in the median are a reason ...", "m", gt=0)
    turn: float = setting(0.01, "... or by so much", "rad", gt=0)
    fewest_visits: int = setting(3, "matched visits that tell it, at least", ge=1)
    pause: int = setting(20, "key scans from one revision to the next, at least ...", ge=1)
    pause_share: float = setting(0.2, "... and such a share of all so far; found loops do not wait", ge=0)
    regular_share: float = setting(0.3, "such a share more key scans are a reason of their own", gt=0)
    early: int = setting(300, "key scans up to which these reasons are enough; after that, loops ...", ge=0)
    late_shift: float = setting(0.1, "... or visits that do not match by so much in the median ...", "m", gt=0)
    late_turn: float = setting(0.03, "... or by so much", "rad", gt=0)
    span_angle: float = setting(
        0.003, "error of the headings that the filter found over long spans, if they are held on the way", "rad", gt=0
    )
    choice_share: float = setting(
        0.6, "such a share more key scans, and it is chosen anew whether the filter's headings are held", gt=0
    )
    first_choice: int = setting(100, "key scans from which it is chosen; before that they are not", ge=1)
    choice_sure: float = setting(0.5, "standard errors from which they are, or are not any more", ge=0)
    settled_distance: float = setting(5e-3, "relaxing stops when no pose moves by more ...", "m", gt=0)
    settled_angle: float = setting(1e-3, "... or turns by more", "rad", gt=0)
    least_move: float = setting(0.02, "a revision that moves no pose farther is dropped", "m", gt=0)
    sure: float = setting(0.5, "standard errors from which the scans prefer a revision")
    doubtful: float = setting(
        0.5, "where one moved the trajectory by more, the end starts from the filter's own, too ...", "m", ge=0
    )
    sure_of_doubtful: float = setting(
        2.0, "... and takes that, unless the scans say otherwise by so many standard errors"
    )


class GraphConfig(Config):
    """What the pose graph of a back end reads: mix it into the back end's settings."""

    scan_matching: ScanMatchingConfig = ScanMatchingConfig()
    odometry: OdometryConfig = OdometryConfig()
    filter_constraints: FilterConstraintsConfig = FilterConstraintsConfig()
    smoothing: SmoothingConfig = SmoothingConfig()
    drift: DriftConfig = DriftConfig()
    loop_closing: LoopClosingConfig = LoopClosingConfig()
    evidence: EvidenceConfig = EvidenceConfig()
    sliding: SlidingConfig = SlidingConfig()
    revision: RevisionConfig = RevisionConfig()
