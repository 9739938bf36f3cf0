"""The tree of frames that /tf and /tf_static span: where one frame sits in another, and how it moves (REP 105)."""

import math
from array import array
from collections import deque
from collections.abc import Callable, Iterable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Values = tuple[float, float, float, float, float, float, float]


def frame_name(name: str) -> str:
    """A frame's name without the leading slash that ROS 1 wrote before tf2."""
    return name.strip().strip("/")


def seconds(stamp: object) -> float:
    """A builtin_interfaces/Time in s."""
    return float(stamp.sec) + 1e-9 * float(stamp.nanosec)  # type: ignore[attr-defined]


class Edge:
    """A child frame's places in its parent over time; of a stretch at rest only its first and last sample is kept."""

    __slots__ = ("_held", "_last", "received", "stamps", "values")

    def __init__(self) -> None:
        self.stamps, self.received, self.values = array("d"), array("d"), array("d")
        self._last: Values | None = None
        self._held: tuple[float, float] | None = None

    def add(self, stamp: float, received: float, values: Values) -> None:
        """One sample: header's stamp and receive time (s), translation (m) and quaternion x y z w."""
        if values == self._last:
            self._held = (stamp, received)
            return
        self.flush()
        self._append(stamp, received, values)
        self._last = values

    def flush(self) -> None:
        """Write the last sample of a stretch at rest; to be called at the end."""
        if self._held is not None and self._last is not None:
            self._append(*self._held, self._last)
            self._held = None

    def _append(self, stamp: float, received: float, values: Values) -> None:
        self.stamps.append(stamp)
        self.received.append(received)
        self.values.extend(values)

    @property
    def moves(self) -> bool:
        """Whether the child is not always at the same place; differences of 1e-6 are rounding."""
        table = np.array(self.values).reshape(-1, 7)
        return bool((np.ptp(table, axis=0) > 1e-6).any())

    def first(self) -> Array:
        """The first place as a (4, 4) matrix."""
        return matrices(np.array([self.values[:7]])).reshape(4, 4)

    def at(self, times: Array, received: bool) -> Array:
        """Places (m, 4, 4) at times (m,) s, interpolated; held outside the span."""
        stamps = np.array(self.received if received else self.stamps)
        table = np.array(self.values).reshape(-1, 7)
        order = np.argsort(stamps, kind="stable")
        stamps, table = stamps[order], table[order]
        turns = table[:, 3:]
        # q and -q are one rotation: keep neighbours on one side, so that interpolation goes the short way.
        flips = np.cumprod(np.where((turns[1:] * turns[:-1]).sum(axis=1) < 0, -1.0, 1.0))
        turns[1:] *= flips[:, None]
        return matrices(np.stack([np.interp(times, stamps, column) for column in table.T], axis=1))


class Transforms:
    """All transforms of a recording, by parent and child."""

    def __init__(self) -> None:
        self.edges: dict[tuple[str, str], Edge] = {}

    def add(self, message: object, received: float) -> None:
        """One TFMessage; what is not finite is left out."""
        for item in message.transforms:  # type: ignore[attr-defined]
            place, turn = item.transform.translation, item.transform.rotation
            values = (place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w)
            if math.isfinite(sum(values)):
                key = (frame_name(item.header.frame_id), frame_name(item.child_frame_id))
                self.edges.setdefault(key, Edge()).add(seconds(item.header.stamp), received, values)

    def flush(self) -> None:
        """To be called when all messages are in."""
        for edge in self.edges.values():
            edge.flush()

    @property
    def frames(self) -> set[str]:
        """The names of all frames."""
        return {frame for key in self.edges for frame in key}

    def without_stamps(self) -> bool:
        """Whether all that moves has header stamps of zero."""
        moving = [edge for edge in self.edges.values() if edge.moves]
        return bool(moving) and not any(any(edge.stamps) for edge in moving)

    def fixed(self, base: str, frame: str) -> tuple[Array, list[str]] | None:
        """Where ``frame`` sits in ``base`` as a (4, 4) matrix, and which links of the chain move; None without a chain.

        A chain of links that never move is preferred; those that do are taken as they were first.
        """
        chain = self._chain(base, frame, lambda edge: not edge.moves) or self._chain(base, frame, lambda edge: True)
        if chain is None:
            return None
        place = np.eye(4)
        for key, forward in chain:
            link = self.edges[key].first()
            place = place @ (link if forward else np.linalg.inv(link))
        return place, [" -> ".join(key) for key, _ in chain if self.edges[key].moves]

    def motion(self, top: str, base: str, received: bool) -> tuple[Array, Array] | None:
        """Stamps (n,) s and poses (n, 3) of ``base`` in ``top``; None without a chain between the two that moves."""
        chain = self._chain(top, base, lambda edge: True)
        if chain is None:
            return None
        moving = [self.edges[key] for key, _ in chain if self.edges[key].moves]
        if not moving:
            return None
        stamps = [np.array(edge.received if received else edge.stamps) for edge in moving]
        times = np.unique(np.concatenate(stamps))
        times = times[(times >= max(s.min() for s in stamps)) & (times <= min(s.max() for s in stamps))]
        if len(times) == 0:
            return None
        place = np.broadcast_to(np.eye(4), (len(times), 4, 4))
        for key, forward in chain:
            link = self.edges[key].at(times, received) if self.edges[key].moves else self.edges[key].first()
            place = place @ (link if forward else np.linalg.inv(link))
        return times, np.stack([place[:, 0, 3], place[:, 1, 3], np.arctan2(place[:, 1, 0], place[:, 0, 0])], axis=1)

    def _chain(self, start: str, end: str, take: Callable[[Edge], bool]) -> list[tuple[tuple[str, str], bool]] | None:
        """The shortest chain of links from one frame to another, each with whether it is passed parent to child."""
        links: dict[str, list[tuple[str, tuple[str, str], bool]]] = {}
        for key, edge in self.edges.items():
            if take(edge):
                links.setdefault(key[0], []).append((key[1], key, True))
                links.setdefault(key[1], []).append((key[0], key, False))
        came: dict[str, tuple[str, tuple[str, str], bool]] = {}
        waiting = deque([start])
        while waiting and end not in came and start != end:
            frame = waiting.popleft()
            for other, key, forward in links.get(frame, []):
                if other != start and other not in came:
                    came[other] = (frame, key, forward)
                    waiting.append(other)
        if start != end and end not in came:
            return None
        chain: list[tuple[tuple[str, str], bool]] = []
        while end != start:
            end, key, forward = came[end]
            chain.append((key, forward))
        return chain[::-1]


def matrices(values: Array) -> Array:
    """(n, 4, 4) from (n, 7): translation and quaternion x y z w, which is normalized; a zero one does not turn."""
    length = np.linalg.norm(values[:, 3:], axis=1)
    x, y, z, w = np.where(length > 1e-6, values[:, 3:].T / np.maximum(length, 1e-6), np.array([[0], [0], [0], [1.0]]))
    out = np.zeros((len(values), 4, 4))
    out[:, 0, :3] = np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)], axis=1)
    out[:, 1, :3] = np.stack([2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)], axis=1)
    out[:, 2, :3] = np.stack([2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)], axis=1)
    out[:, :3, 3], out[:, 3, 3] = values[:, :3], 1.0
    return out


def pick(frames: Iterable[str], names: Iterable[str]) -> list[str]:
    """The frames called like one of these, a robot's prefix (``robot1/odom``) aside; in the order of the names."""
    known = sorted(frames)
    return [frame for name in names for frame in known if frame.rsplit("/", 1)[-1] == name]
