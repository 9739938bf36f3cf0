"""The whole trajectory in hindsight: key scans matched with their neighbours, and the pose graph relaxed.

Graph-based SLAM as in Lu & Milios (1997) and Konolige et al. (2010), started from the particle filter's trajectory.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.slam.graph.drift import Drift, joint_deviations, match_deviation, spanned
from pfslam_viz.slam.graph.evidence import compare
from pfslam_viz.slam.graph.filter_constraints import filter_constraints, heading_spans
from pfslam_viz.slam.graph.loop_closing import confirmed, find_loops
from pfslam_viz.slam.graph.odometry_errors import OdometryErrors
from pfslam_viz.slam.graph.pose_graph import Constraints, optimize, residuals, turned, weights
from pfslam_viz.slam.graph.proven_odometry import contradicting, laid_out, prove, refuted
from pfslam_viz.slam.graph.scan_store import ScanStore, trusted
from pfslam_viz.slam.graph.settings import GraphConfig, SmoothingConfig
from pfslam_viz.slam.graph.sliding import hold_along
from pfslam_viz.slam.graph.visits import earlier_visits

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Smoothed:
    """Key poses (k, 3) in hindsight, and the pairs (p, 2) of key scans whose loops were closed to get there."""

    poses: Array
    closed: Indices


class Smoother:
    """The pose graph over one recording's key scans.

    ``odometry`` (k, 3) leads from every key scan to the next; row 0 is not used. ``found`` (k - 1, 3) is what the
    filter made of it. ``unknown`` (k, 3) m, m, rad is by how much the odometry may be wrong besides its noise, where
    it knew nothing.
    """

    def __init__(
        self, scans: ScanStore, odometry: Array, found: Array, config: GraphConfig, unknown: Array | None = None
    ) -> None:
        self.scans, self.config, self.loops = scans, config.smoothing, config.loop_closing
        self._settings = config
        self._odometry, self._found = odometry, found
        self._unknown = np.zeros_like(odometry) if unknown is None else unknown
        self.errors = OdometryErrors(config.odometry)  # the odometry's, once they are learned
        self._slipped = np.zeros(len(found), np.bool_)  # steps at which good odometry did
        self._kept: tuple[bytes, tuple[Constraints, Constraints]] | None = None  # what was matched last
        self.held = False  # whether the filter's headings over long spans are held
        self.misled = False  # whether matches were wrong where proven odometry was right

    def smooth(self, poses: Array) -> Smoothed:
        """The key poses that agree best with all matches between neighbouring key scans and with the odometry.

        The first pose stays. Loops that the particles missed are closed, as :meth:`close_best` says.
        """
        closed = np.zeros((0, 2), np.int64)
        if len(poses) < 3:
            return Smoothed(poses, closed)
        poses, _ = self.relax(poses, np.array(self.config.first_gates))
        self.share_walls(poses)
        self.learn_errors(poses)
        poses = self.straighten(poses)
        poses, support = self.choose_held(poses, self._settings.filter_constraints.sure)
        if self.loops.enabled:
            for _ in range(self.loops.searches):
                loops = find_loops(self.scans, poses, self.drift(poses, closed), self.loops) + self.slid(poses)
                poses, support, joined = self.close_best(poses, support, loops)
                if len(joined) == 0:
                    break
                closed = np.concatenate([closed, joined])
        self.share_walls(poses)
        for _ in range(self.config.rounds - 2):
            poses, _ = self.relax(poses, np.array(self.config.gates))
        return Smoothed(poses, closed)

    def close_best(self, poses: Array, support: float, loops: list[Constraints]) -> tuple[Array, float, Indices]:
        """Close ``loops``, all of them or else the first of them that is worth it.

        It is if the graph as a whole finds more ``support`` with it closed than without, or scans that it did not match
        do. Returns poses, support and the pairs (p, 2) of key scans that are held together now, none if nothing was.
        """
        for loop in ([Constraints.join(loops)] if len(loops) > 1 else []) + loops:
            trial, trial_support = self.close(poses, loop)
            if self.is_better(trial, poses, trial_support - support):
                return trial, trial_support, np.stack([loop.start, loop.end], axis=-1)
        return poses, support, np.zeros((0, 2), np.int64)

    def share_walls(self, poses: Array, since: int = 0) -> None:
        """Find the walls' directions anew, as :meth:`ScanStore.share_walls`; matches from now on go by them."""
        self.scans.share_walls(poses, since)
        self._kept = None

    def relax(self, poses: Array, gates: Array) -> tuple[Array, float]:
        """Match all neighbours and relax the graph once: poses (k, 3), and the sum of all constraints' weights."""
        return self._relax_by(poses, self._match(poses, gates)[0], self.held)

    def _match(self, poses: Array, gates: Array) -> tuple[Constraints, Constraints]:
        """All neighbours matched, visits held along corridors; and those of them that are to slide along one.

        What came of the last call is kept: drift, loops and the relaxing after them often ask for the same.
        """
        asked = poses.tobytes() + gates.tobytes()
        if self._kept is None or self._kept[0] != asked:
            pairs = neighbouring(poses, self.config)
            self._kept = asked, match_neighbours(self.scans, poses, pairs, gates, self._settings)
        return self._kept[1]

    def slid(self, poses: Array) -> list[Constraints]:
        """Loops to be closed along corridors, where free space tells two visits further apart than their match does."""
        _, slid = self._match(poses, np.array(self.config.gates))
        return confirmed(poses, slid, self.loops)

    def _relax_by(self, poses: Array, matched: Constraints, held: bool) -> tuple[Array, float]:
        """The same with what is ``matched`` already, and the filter's headings ``held`` or not."""
        constraints = Constraints.join([*self._driven(poses, matched, held), matched])
        poses = self._optimize(poses, constraints, self.config.iterations)
        return poses, float(weights(poses, constraints, self.config.scale).sum())

    def _driven(self, poses: Array, matched: Constraints, held: bool) -> list[Constraints]:
        """What is known of the motion from key scan to key scan besides the ``matched`` scans."""
        bridged = self._bridged(poses, matched)
        alone = np.flatnonzero(~bridged)  # elsewhere the filter's say would count the same scans twice
        c = self._settings.filter_constraints
        spans = heading_spans(self._found, c) if held else []
        return [self._motion(poses, bridged), filter_constraints(self.scans, self._found, alone, c), *spans]

    def _bridged(self, poses: Array, matched: Constraints) -> NDArray[np.bool_]:
        """Which joints (k - 1,) between key scans what is ``matched`` reaches over."""
        return spanned(matched, len(poses), max(self.config.hops))

    def _motion(self, poses: Array, bridged: NDArray[np.bool_]) -> Constraints:
        """What the odometry says where joints (k - 1,) are ``bridged`` by matches, and where not."""
        motion = odometry_constraints(self._odometry, self.config, self.errors, bridged, self._unknown, self._slipped)
        return hold_together(poses, motion, self.config.scale)

    def choose_held(self, poses: Array, sure: float) -> tuple[Array, float]:
        """Decide whether to hold the headings that the filter found over long spans, and relax the graph accordingly.

        Errors of matches between neighbours that are alike (a lidar whose ranges are off bends every wall the same way)
        add up along the way; those of matches with the map do not, as long as the same walls are in view. Elsewhere the
        neighbours are the better witness. Scans that were not matched with each other tell which it is, if they are
        ``sure`` by so many standard errors; it stays as it is where they are not.
        """
        gates = np.array(self.config.gates)
        if not self._settings.filter_constraints.spans:
            return self.relax(poses, gates)
        matched, _ = self._match(poses, gates)
        other = self.scans.worker.submit(lambda: self._relax_by(poses, matched, held=True))
        free = self._relax_by(poses, matched, held=False)
        held = other.result()
        verdict = compare(self.scans, held[0], free[0], self._settings.evidence)
        self.held = verdict.sigmas > (-sure if self.held else sure)  # as before, unless there is good reason to change
        return held if self.held else free

    def learn_errors(self, poses: Array) -> OdometryErrors:
        """Find the wheels' scale and the odometry's noise from all successive key scans that can tell.

        A worn or badly measured wheel is wrong by the same share everywhere. Where a corridor leaves the scans no say,
        the odometry then says what it says elsewhere, corrected.
        """
        gates = np.array(self.config.gates)
        if self.config.hops.count(1) == 1:
            found, _ = self._match(poses, gates)
        else:
            successive = np.stack([np.arange(len(poses) - 1), np.arange(1, len(poses))], axis=-1)
            found = match(self.scans, poses, successive, gates, self.config)
        known = ~self._unknown[found.end].any(axis=1)
        found = found.pick(np.flatnonzero(known & (found.end - found.start == 1)))
        deviation = odometry_deviation(self._odometry[1:], self.config)
        config = self._settings.odometry
        errors = self.errors = OdometryErrors.of(
            config, self._odometry[found.end], found.measured, found.information, deviation[found.start]
        )
        told = np.zeros(len(poses) - 1, np.bool_)
        told[found.start] = errors.known(found.information)
        errors.proven = prove(poses, self._steps(errors.scale), deviation, told, config)
        errors.held = errors.proven[1] if self.misled else 1.0
        return errors

    def _steps(self, scale: float) -> Array:
        """The odometry (k - 1, 3) from key scan to key scan with the wheels' ``scale``."""
        steps: Array = self._odometry[1:] * [scale, scale, 1.0]
        return steps

    def doubted(self, poses: Array, errors: OdometryErrors | None = None) -> NDArray[np.bool_]:
        """Which steps (k - 1,) of the trajectory contradict proven odometry, as learned or as ``errors`` say it is.

        But for those at which scans clearly show that it slipped.
        """
        doubted, _ = self._contradicting(poses, errors or self.errors)
        return doubted

    def _contradicting(self, poses: Array, errors: OdometryErrors) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Steps (k - 1,) that contradict proven odometry: those to be doubted, and those at which it slipped."""
        config, steps = self._settings.odometry, self._steps(errors.scale)
        deviation = odometry_deviation(self._odometry[1:], self.config)
        joints = contradicting(poses, steps, deviation, errors.proven, config) & ~self._unknown[1:].any(axis=1)
        slipped = refuted(self.scans, poses, steps, joints, config, self._settings.evidence)
        return joints & ~slipped, slipped

    def straighten(self, poses: Array) -> Array:
        """Key poses (k, 3) led by odometry that has proven right, if a step of these contradicts it.

        They are laid out as it says and matched anew from there, with its heading held if that is proven. Unless the
        scans say that these are better.
        """
        doubted, self._slipped = self._contradicting(poses, self.errors)
        if not doubted.any():
            return poses
        held, self.errors.held = self.errors.held, self.errors.proven[1]
        other = laid_out(poses, self._steps(self.errors.scale), self.errors.proven, self._slipped)
        for gates in (self.config.first_gates, self.config.gates):
            other, _ = self.relax(other, np.array(gates))
        if compare(self.scans, other, poses, self._settings.evidence).sigmas < -self._settings.odometry.overruled:
            self.errors.held = held
            return poses
        self.misled = True
        self.share_walls(other)
        self.learn_errors(other)
        return other

    def asked_of(self, trial: Array, poses: Array, sigmas: float) -> float:
        """The standard errors by which scans must prefer the ``trial`` (k, 3) to the ``poses`` (k, 3).

        So many ``sigmas``; but a trial that contradicts proven odometry less often only must not be clearly worse.
        """
        better = np.count_nonzero(self.doubted(trial)) < np.count_nonzero(self.doubted(poses))
        return min(sigmas, -self._settings.odometry.overruled) if better else sigmas

    def is_better(self, trial: Array, poses: Array, gain: float) -> bool:
        """Whether a loop is to be closed: ``trial`` (k, 3) with it closed, ``poses`` (k, 3) without.

        ``gain`` is by how many more matches the graph agrees. Either that speaks for it clearly, or scans that the
        graph did not match do; the other must not speak against it.
        """
        verdict = compare(self.scans, trial, poses, self._settings.evidence)
        if gain > self.loops.gain:
            return verdict.sigmas > 0.0
        return gain > -self.loops.gain and verdict.sigmas > self._settings.evidence.sure

    def drift(self, poses: Array, closed: Indices) -> Drift:
        """How far key scans may have drifted apart, though visits are matched and the loops (p, 2) are closed."""
        c = self.config
        matched, _ = self._match(poses, np.array(c.gates))
        deviation = match_deviation(self.sound(poses, matched), c.hops, self._settings.drift)
        return self.drift_by(poses, closed, matched, deviation)

    def drift_by(self, poses: Array, closed: Indices, matched: Constraints, deviation: Array) -> Drift:
        """The same from what is ``matched``, with the ``deviation`` (2,) m, rad of matches between neighbours."""
        hops, config = self.config.hops, self._settings.drift
        matched = self.sound(poses, matched)
        visits = visits_of(matched, self.config)
        links = np.concatenate([closed, np.stack([visits.start, visits.end], axis=-1)])
        motion = self._motion(poses, self._bridged(poses, matched))
        joints = joint_deviations(matched, motion, len(poses), max(hops), config.caution * deviation)
        return Drift(poses, joints, links, config.links)

    def sound(self, poses: Array, matched: Constraints) -> Constraints:
        """Those matches that ``poses`` agree with."""
        return matched.pick(np.flatnonzero(weights(poses, matched, self.config.scale) > self.loops.sound))

    def close(self, poses: Array, loop: Constraints) -> tuple[Array, float]:
        """Pull the graph together at ``loop``, then let it relax without: as :meth:`relax`."""
        c = self.config
        first_gates, gates = np.array(c.first_gates), np.array(c.gates)
        matched, _ = self._match(poses, gates)
        sound, longest = self.sound(poses, matched), max(c.hops)
        chain = sound.pick(np.flatnonzero(sound.end - sound.start <= longest))
        firm = chain.firm()  # what joins successive scans bends, it does not snap
        pulled = Constraints.join([*self._driven(poses, matched, self.held), firm, visits_of(matched, c), loop])
        poses = self._optimize(poses, pulled, 2 * c.iterations)  # a pull from far takes longer
        poses, _ = self.relax(poses, first_gates)
        return self.relax(poses, gates)

    def _optimize(self, poses: Array, constraints: Constraints, iterations: int) -> Array:
        c = self.config
        return optimize(
            poses,
            constraints,
            iterations=iterations,
            scale=c.scale,
            settled_distance=c.settled_distance,
            settled_angle=c.settled_angle,
        )


def neighbouring(poses: Array, config: SmoothingConfig, since: int = 0) -> Indices:
    """Pairs (p, 2) of key scans to match, the earlier first: those a few hops on, and the nearest of earlier visits.

    Only those whose later one is ``since`` or after it.
    """
    n = len(poses)
    pairs = [
        np.stack([np.arange(max(since - hop, 0), n - hop), np.arange(max(since, hop), n)], axis=-1)
        for hop in config.hops
        if hop < n
    ]
    pairs.append(earlier_visits(poses, config.radius, config.apart, config.neighbours, config.turn_length, since))
    return np.concatenate(pairs)


def visits_of(matched: Constraints, config: SmoothingConfig) -> Constraints:
    """Those of the ``matched`` pairs that are of two visits, further apart than the hops go on."""
    return matched.pick(np.flatnonzero(matched.end - matched.start > max(config.hops)))


def match(scans: ScanStore, poses: Array, pairs: Indices, gates: Array, config: SmoothingConfig) -> Constraints:
    """The pairs (p, 2) that match: as constraints, robust, tempered; the others are left out."""
    start, end = pairs[:, 0], pairs[:, 1]
    guesses = geometry.between(poses[start], poses[end])
    prior = np.array([config.guess_distance, config.guess_distance, config.guess_angle]) ** -2.0
    stride = max(1, round(scans.first[-1] / len(scans) / config.match_points))
    found = scans.match(start, end, guesses, prior, gates, stride=stride, iterations=config.match_iterations)
    good = trusted(found, guesses, config)
    information = config.temper * turned(found.information, found.poses[:, 2])
    return Constraints(start[good], end[good], found.poses[good], information[good], np.ones(good.sum(), np.bool_))


def match_neighbours(
    scans: ScanStore, poses: Array, pairs: Indices, gates: Array, config: GraphConfig
) -> tuple[Constraints, Constraints]:
    """As :func:`match`, with visits held along corridors by free space; and those that are to slide along one."""
    matched = match(scans, poses, pairs, gates, config.smoothing)
    visits = visits_of(matched, config.smoothing)
    if not config.sliding.enabled:
        return matched, visits.pick(np.zeros(0, np.int64))
    near = matched.pick(np.flatnonzero(matched.end - matched.start <= max(config.smoothing.hops)))
    visits, slid = hold_along(scans, visits, config.sliding, config.evidence)
    return Constraints.join([near, visits]), slid


def odometry_deviation(steps: Array, config: SmoothingConfig) -> Array:
    """The noise (k, 3) m, m, rad that the settings expect of odometry steps (k, 3)."""
    driven, turned_by = np.hypot(steps[:, 0], steps[:, 1]), np.abs(steps[:, 2])
    deviation = np.empty_like(steps)
    deviation[:, 0] = deviation[:, 1] = config.least + config.noise_distance * driven
    deviation[:, 2] = config.least + config.noise_angle * turned_by + config.noise_drift * driven
    return deviation


def odometry_constraints(
    odometry: Array,
    config: SmoothingConfig,
    errors: OdometryErrors,
    bridged: NDArray[np.bool_],
    unknown: Array | None = None,
    slipped: NDArray[np.bool_] | None = None,
) -> Constraints:
    """The odometry (k, 3) from every key scan to the next: what holds where the scans leave a direction open.

    Where no match bridges a joint (k - 1,), the odometry is as firm as it has proven to be, and not robust. Elsewhere
    it is as loose as the settings say: its errors are alike over many steps (a gyro's bias), and must not bend what
    the scans know. Only once matches were found to be wrong, a heading that has proven right is held
    there, by a constraint of its own, but where it ``slipped`` (k - 1,).
    ``unknown`` (k, 3) m, m, rad is added to the odometry's noise; where there is any, it has not proven anything.
    """
    deviation = odometry_deviation(odometry[1:], config)
    added = np.zeros_like(deviation) if unknown is None else unknown[1:]
    guessed = added.max(axis=1, initial=0.0) > 0.0
    loose = bridged | guessed
    deviation *= np.where(loose[:, None], 1.0, [errors.distance, errors.distance, errors.angle])
    free = guessed if slipped is None else guessed | slipped
    if errors.held < 1.0:
        deviation[bridged & ~free, 2] *= errors.held
    deviation += added
    steps = odometry[1:] * np.where(guessed[:, None], 1.0, [errors.scale, errors.scale, 1.0])
    information = np.zeros((len(steps), 3, 3))
    information[:, [0, 1, 2], [0, 1, 2]] = deviation**-2
    at = np.arange(len(steps))
    if errors.held == 1.0:
        return Constraints(at, at + 1, steps, information, loose)
    heading = np.zeros_like(information)
    heading[:, 2, 2] = information[:, 2, 2]
    position = Constraints(at, at + 1, steps, information - heading, loose)
    return Constraints.join([position, Constraints(at, at + 1, steps, heading, free)])


def hold_together(poses: Array, motion: Constraints, scale: float) -> Constraints:
    """The same, but those that are not robust with Huber's weights at ``poses`` (k, 3).

    They pull the less the further off they are, but never let go, as a robust constraint would: where nothing else
    holds, letting go costs next to nothing, and the trajectory tears.
    """
    e = residuals(poses, motion)
    away = np.sqrt(np.einsum("ki,kij,kj->k", e, motion.information, e))
    pull = np.where(motion.robust, 1.0, np.minimum(1.0, scale / np.maximum(away, 1e-9)))
    return replace(motion, information=motion.information * pull[:, None, None])
