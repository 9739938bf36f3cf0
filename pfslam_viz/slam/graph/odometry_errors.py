"""How far the odometry is to be believed, found out while driving from what the scans say about the same motion.

Robots differ: one's wheels are right to a degree in an hour, another's err by degrees at every metre. The settings give
the shape of the error (so much per metre, so much per radian); how large it is on this robot follows from the residuals
between odometry and good scan matches, by medians, which a slipping wheel or a wrong match does not spoil. As in
adaptive filtering by innovations (Mehra 1970), with the median absolute deviation for the variance (Huber 1981).
"""

import math

import numpy as np
from numpy.typing import NDArray

from pfslam_viz.slam.graph.settings import OdometryConfig

Array = NDArray[np.float64]

NORMAL = 1.4826  # standard deviation of a normal distribution per median absolute deviation


class OdometryErrors:
    """The errors of one robot's odometry so far.

    Attributes:
        scale: metres driven per metre that the odometry says.
        distance: its position's noise, as a multiple of what the settings say.
        angle: its heading's.
        proven: the same two, 1 unless they are so small over longer spans, too (:func:`~.proven_odometry.prove`).
        held: that of the heading where scans match, too; 1 unless matches are known to have been wrong.
    """

    def __init__(self, config: OdometryConfig, *, forget: bool = True) -> None:
        """Only the last ``memory`` motions count; all of them unless errors ``forget``."""
        self.config = config
        memory = config.memory if forget else None
        self.scale = self.distance = self.angle = 1.0
        self.proven = 1.0, 1.0
        self.held = 1.0
        self._turns = Latest(1, memory)  # over what the settings expect
        self._motions = Latest(4, memory)  # those that tell the scale

    @classmethod
    def of(
        cls, config: OdometryConfig, odometry: Array, found: Array, information: Array, deviation: Array
    ) -> "OdometryErrors":
        """Of many motions at once, (k, 3), (k, 3), (k, 3, 3), (k, 3); see :meth:`add`."""
        errors = cls(config, forget=False)
        for motion in zip(odometry, found, errors.known(information), deviation, strict=True):
            errors._remember(*motion)
        errors._evaluate()
        return errors

    def add(self, odometry: Array, found: Array, information: Array, deviation: Array) -> None:
        """A motion that is known twice: by the raw ``odometry`` (3,) and as ``found`` (3,) by a good match of scans.

        ``information`` (3, 3) is the match's, ``deviation`` (3,) the odometry's noise as the settings say it.
        """
        self._remember(odometry, found, bool(self.known(information)), deviation)
        self._evaluate()

    def known(self, information: Array) -> NDArray[np.bool_]:
        """Whether matches' information (..., 3, 3) leaves no direction open."""
        position = information[..., :2, :2]
        least = self.config.scale_known * (position[..., 0, 0] + position[..., 1, 1])
        known: NDArray[np.bool_] = np.linalg.eigvalsh(position)[..., 0] >= least
        return known

    def _remember(self, odometry: Array, found: Array, known: bool, deviation: Array) -> None:
        turn = math.remainder(found[2] - odometry[2], 2.0 * math.pi)
        self._turns.append((abs(turn) / deviation[2],))
        driven = math.hypot(odometry[0], odometry[1])
        if driven < self.config.scale_driven or not known:
            return
        ahead = float(found[0] * odometry[0] + found[1] * odometry[1]) / driven
        aside = float(found[1] * odometry[0] - found[0] * odometry[1]) / driven
        self._motions.append((driven, ahead, aside, float(deviation[0])))

    def _evaluate(self) -> None:
        self.angle = self._multiple(self._turns.columns[0])
        if len(self._motions) < self.config.scale_motions:
            return
        driven, ahead, aside, deviation = self._motions.columns
        scale = _median(ahead / driven)
        self.scale = scale if 1.0 / self.config.largest_scale < scale < self.config.largest_scale else 1.0
        missed = np.abs(np.concatenate([ahead - self.scale * driven, aside]))
        self.distance = self._multiple(missed / np.tile(deviation, 2))

    def _multiple(self, ratios: Array) -> float:
        """The noise's multiple that absolute residuals over their expected deviation speak for.

        The settings have a say, as so many motions that agree with them.
        """
        c = self.config
        values = np.concatenate([ratios, np.full(c.prior_motions, 1.0 / NORMAL)])
        return float(np.clip(NORMAL * _median(values), c.least_noise, c.most_noise))


class Latest:
    """The last ``most`` rows of so many numbers, or all of them, in no order: medians ask for none."""

    def __init__(self, width: int, most: int | None) -> None:
        self._most, self._count = most, 0
        self._columns = np.empty((width, 64))

    def __len__(self) -> int:
        return self._count if self._most is None else min(self._count, self._most)

    def append(self, row: tuple[float, ...]) -> None:
        """Remember ``row``, in the place of the oldest one if there are enough."""
        at = self._count if self._most is None else self._count % self._most
        if at == self._columns.shape[1]:
            self._columns = np.concatenate([self._columns, np.empty_like(self._columns)], axis=1)
        self._columns[:, at] = row
        self._count += 1

    @property
    def columns(self) -> Array:
        """(width, n)."""
        return self._columns[:, : len(self)]


def _median(values: Array) -> float:
    """As NumPy's, in a fifth of the time for as few values as these."""
    middle = len(values) // 2
    if len(values) % 2 == 1:
        return float(np.partition(values, middle)[middle])
    below, above = np.partition(values, [middle - 1, middle])[middle - 1 : middle + 1]
    return float((below + above) / 2.0)
