"""The particles' ancestry: whose map and trajectory each of them carries on."""

import numpy as np
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.compiling.kernel import kernel
from pfslam_viz.slam.tiles import enlarged

Array = NDArray[np.float64]
Indices = NDArray[np.intp]


class History:
    """The poses of N particles at the key scans, who descends from whom, and the odometry in between."""

    def __init__(self, count: int) -> None:
        self.keys: list[int] = []  # position of every key scan among the scans so far
        self._count = 0
        self._poses = np.empty((64, count, 3))
        self._parents = np.empty((64, count), np.intp)
        self._found = np.zeros((0, 3))  # the filter's increments before poses were taken over from elsewhere
        self._carried: Indices = np.arange(count)  # who each particle was at the last key scan
        self._key_of: list[int] = []  # number of the last key scan, for every scan
        self._offsets: list[Array] = []  # from that key scan, for every scan
        self._odometry = np.empty((64, 3))  # from key scan to key scan
        self._moved = np.empty((64, 3))  # the same, corrected by matching the scans
        self._unknown = np.empty((64, 1))  # s without odometry from key scan to key scan

    def __len__(self) -> int:
        """How many key scans there are."""
        return self._count

    def add_key(self, poses: Array, odometry: Array, moved: Array, unknown: float = 0.0) -> None:
        """A scan was used, with the particles at ``poses`` (N, 3).

        ``odometry`` (3,) led there from the key scan before, ``moved`` (3,) is what scan matching made of it;
        ``unknown`` s of the time in between the odometry did not know. Call it before :meth:`add_scan`.
        """
        if self._count == len(self._poses):
            more = self._count
            self._poses, self._parents = enlarged(self._poses, more), enlarged(self._parents, more)
            self._odometry, self._moved = enlarged(self._odometry, more), enlarged(self._moved, more)
            self._unknown = enlarged(self._unknown, more)
        self.keys.append(len(self._key_of))
        self._poses[self._count] = poses
        self._odometry[self._count] = odometry
        self._moved[self._count] = moved
        self._unknown[self._count] = unknown
        self._parents[self._count] = self._carried
        self._count += 1
        self._carried = np.arange(len(poses))

    def add_scan(self, offset: Array) -> None:
        """A scan came in at ``offset`` (3,) from the last key scan, which is zero for a key scan itself."""
        self._key_of.append(self._count - 1)
        self._offsets.append(offset)

    def resample(self, ancestors: Indices) -> None:
        """Particle p now carries on what particle ``ancestors[p]`` was."""
        self._carried = self._carried[ancestors]

    def key_poses(self, particle: int) -> Array:
        """(keys, 3) poses at the key scans of the particle that is number ``particle`` now."""
        return _descent(self._poses, self._parents, self._count, int(self._carried[particle]))

    def increments(self, particle: int) -> Array:
        """(keys - 1, 3) from each key pose to the next as the filter found them, whatever became of the poses since."""
        poses = self.key_poses(particle)[len(self._found) :]
        return np.concatenate([self._found, geometry.between(poses[:-1], poses[1:])])

    def rebase(self, particle: int, key_poses: Array, poses: Array) -> None:
        """From now on all particles have come along ``key_poses`` (keys, 3), and stand at ``poses`` (N, 3).

        What the filter itself found is kept as it was on ``particle``'s way. Call it at a key scan.
        """
        self._found = self.increments(particle)
        self._poses[: self._count] = key_poses[:, None]
        self._poses[self._count - 1] = poses
        self._carried = np.arange(len(poses))

    def trajectory(self, key_poses: Array) -> Array:
        """(n, 3) a pose for every scan so far, through ``key_poses`` (keys, 3).

        Between two key scans the offsets' shape is kept; what they miss the second one by is spread evenly.
        """
        key, offset = np.array(self._key_of), np.array(self._offsets).reshape(-1, 3)
        if len(key) == 0:
            return np.zeros((0, 3))
        out = geometry.compose(key_poses[key], offset)
        first = np.array(self.keys)
        share = (np.arange(len(key)) - first[key]) / np.diff(first, append=len(key))[key]
        inner = key < len(key_poses) - 1
        moved = self._moved[1 : self._count]
        missed = geometry.between(moved, geometry.between(key_poses[:-1], key_poses[1:]))
        out[inner] = geometry.compose(out[inner], missed[key[inner]] * share[inner, None])
        return out

    def odometry(self) -> Array:
        """(keys, 3) the odometry that led from the key scan before to each key scan; zero for the first."""
        return self._odometry[: self._count].copy()

    def unknown(self) -> Array:
        """(keys, 1) s before each key scan of which the odometry knows nothing."""
        return self._unknown[: self._count].copy()


@kernel("f8[:, :, ::1], i8[:, ::1], i8, i8")
def _descent(poses: Array, parents: Indices, count: int, at: int) -> Array:
    """(count, 3) the poses of particle ``at`` and its ancestors; of ``poses`` (count, N, 3), ``parents`` (count, N)."""
    out = np.empty((count, 3))
    for k in range(count - 1, -1, -1):
        for axis in range(3):
            out[k, axis] = poses[k, at, axis]
        at = parents[k, at]
    return out
