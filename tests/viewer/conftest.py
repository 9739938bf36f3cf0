"""A small simulated corridor and its Steps: what the viewer's tests log. No filter takes part."""

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.config import Config
from pfslam_viz.recordings.recording import Frames, Lidar, Recording, Trajectory
from pfslam_viz.replay import Result
from pfslam_viz.robot import CameraGeometry
from pfslam_viz.settings import ResamplingConfig
from pfslam_viz.slam.occupancy_grid import OccupancyGrid
from pfslam_viz.slam.protocol import Estimate, LoopClosure, Match
from pfslam_viz.step import Step
from pfslam_viz.texture.floor_texture import FloorTexture
from pfslam_viz.viewer.blueprint import BACKGROUND
from pfslam_viz.viewer.collector import StreamOptions
from pfslam_viz.viewer.connections import viewer_binary
from pfslam_viz.viewer.sinks import open_sinks
from pfslam_viz.viewer.stream import replay_stream

Array = NDArray[np.float64]

SCANS, BEAMS, PARTICLES = 60, 91, 40
BLIND = (20, 21)  # scans without a match with the map, where everything is made up
LENGTH, HALF_WIDTH = 8.0, 1.5  # m: a corridor along x, closed at both ends


def _ranges(pose: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """Distance (m) to the nearest of the corridor's four walls, along each beam."""
    direction = np.stack([np.cos(pose[2] + angles), np.sin(pose[2] + angles)])
    with np.errstate(divide="ignore"):
        to_wall = [
            (wall - pose[axis]) / direction[axis]
            for axis, wall in ((0, -1.0), (0, LENGTH - 1.0), (1, -HALF_WIDTH), (1, HALF_WIDTH))
        ]
    return np.asarray(np.min([np.where(t > 0, t, np.inf) for t in to_wall], axis=0))


@dataclass
class Corridor:
    """The recording, the configuration, and Steps made from the truth with a made-up cloud about it."""

    recording: Recording
    config: Config
    rich: bool

    def steps(self) -> Iterator[Step]:
        rng = np.random.default_rng(7)
        recording = self.recording
        assert recording.truth is not None
        truth, reckoned = recording.truth.poses, recording.dead_reckoning()
        grid, reckoned_grid = OccupancyGrid(self.config.map), OccupancyGrid(self.config.map)
        for k in range(len(recording)):
            beams = recording.ranges[k][:, None].astype(float)
            angles = recording.lidar.angles
            points = beams * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
            particles = truth[k] + rng.normal(0.0, [0.03, 0.02, 0.01], (PARTICLES, 3))
            weights = rng.random(PARTICLES)
            weights /= weights.sum()
            best = particles[np.argmax(weights)]
            end_points = geometry.transform(best, points)
            cells = grid.cells(end_points)
            inside = ((cells >= 0) & (cells < grid.shape)).all(axis=1)
            hits = np.zeros(len(cells), bool)
            hits[inside] = grid.occupied[cells[inside, 0], cells[inside, 1]] > 0
            grid.add(best, points, np.zeros(2))
            reckoned_grid.add(reckoned[k], points, np.zeros(2))
            match = Match(np.array([0.01, 0.0, 0.002]), 0.8, np.array([1.0, 0.0]) if k % 2 else None)
            yield Step(
                index=k,
                stamp=float(recording.stamps[k]),
                time=float(recording.times[k]),
                estimate=Estimate(
                    particles=particles,
                    weights=weights,
                    best=best,
                    mean=geometry.mean_pose(particles, weights),
                    covariance=np.cov(particles.T, aweights=weights, ddof=0),
                    n_eff=float(1.0 / (weights**2).sum()),
                    resampled=k % 4 == 3,
                    informative=not (self.rich and k in BLIND),
                    parents=rng.integers(0, PARTICLES, PARTICLES),
                    match=match if self.rich else None,
                ),
                dead_reckoning=reckoned[k],
                revision=None,
                end_points=end_points,
                hits=hits,
                dead_reckoning_end_points=geometry.transform(reckoned[k], points),
                grid=grid,
                dead_reckoning_grid=reckoned_grid,
                texture=None,
                color_frame=None,
                disparity_frame=None,
                truth=truth[k],
                seconds={"update": 0.001},
            )

    def result(self, steps: list[Step], interrupted: bool = False) -> Result:
        n = len(steps)
        online = np.array([s.estimate.best for s in steps])
        return Result(
            recording=self.recording,
            config=self.config,
            stamps=self.recording.stamps[:n],
            estimate=online + np.array([0.02, 0.0, 0.0]) if self.rich else online,
            online=online,
            dead_reckoning=np.array([s.dead_reckoning for s in steps]),
            truth=np.array([s.truth for s in steps]),
            grid=steps[-1].grid,
            dead_reckoning_grid=steps[-1].dead_reckoning_grid,
            seconds={"update": np.full(n, 0.001)},
            resamplings=n // 4,
            uninformative=len(BLIND) if self.rich else 0,
            interrupted=interrupted,
            closures=(LoopClosure(0, n - 1, online[0, :2], online[n - 1, :2]),) if self.rich else (),
            texture=self._texture(steps) if self.rich else None,
            skipped_frames=None,
        )

    def _texture(self, steps: list[Step]) -> FloorTexture:
        """A patch of floor."""
        frames = self.recording.frames
        assert frames is not None
        texture = FloorTexture(frames.camera, self.config.texture, steps[-1].grid.cell)
        texture.color[70:80, 60:90], texture.weight[70:80, 60:90] = (200, 90, 40), 1.0
        return texture


def _corridor(folder: Path, rich: bool) -> Corridor:
    stamps: Array = 100.0 + 0.25 * np.arange(SCANS, dtype=np.float64)
    s = np.linspace(0.0, 5.0, SCANS)
    truth: Array = np.stack([s, 0.3 * np.sin(s), 0.3 * np.cos(s) - 0.3], axis=-1)
    truth[:, 2] -= truth[0, 2]
    odometry = np.zeros((SCANS, 3))
    odometry[1:] = geometry.between(truth[:-1], truth[1:]) + np.array([0.0, 0.0, 0.004])  # a gyro's bias
    angles = np.linspace(-2.3, 2.3, BEAMS)
    ranges = np.array([_ranges(pose, angles) for pose in truth], np.float32)
    frames = None
    if rich:
        color, disparity = folder / "color.png", folder / "disparity.png"
        cv2.imwrite(str(color), np.full((480, 640, 3), (40, 90, 200), np.uint8))
        cv2.imwrite(str(disparity), np.full((480, 640), 700, np.uint16))
        at: Array = stamps[::10]
        camera = CameraGeometry(position=(0.33, 0.0, 0.5), pitch=0.31)
        frames = Frames(at, (color,) * len(at), at + 0.01, (disparity,) * len(at), camera)
    recording = Recording(
        name="corridor",
        format="ece276a",
        path=folder,
        stamps=stamps,
        ranges=ranges,
        lidar=Lidar(angles, 0.1, 30.0, np.zeros(3)),
        odometry=odometry,
        frames=frames,
        truth=Trajectory(stamps, truth),
    )
    return Corridor(
        recording, Config(name="test", particles=PARTICLES, resampling=ResamplingConfig(policy="n_eff")), rich
    )


@pytest.fixture(scope="session")
def corridor(tmp_path_factory: pytest.TempPathFactory) -> Corridor:
    """Everything a recording can show: matches, a loop closure, hindsight, camera images, texture."""
    return _corridor(tmp_path_factory.mktemp("corridor"), rich=True)


@pytest.fixture(scope="session")
def plain_corridor(tmp_path_factory: pytest.TempPathFactory) -> Corridor:
    """What the paper's filter gives: particles and maps."""
    return _corridor(tmp_path_factory.mktemp("plain"), rich=False)


@dataclass
class Recorded:
    """A recording file, what wrote it, and the Steps that went in."""

    path: Path
    corridor: Corridor
    steps: list[Step]
    left_out: list[str]


def record(corridor: Corridor, path: Path, options: StreamOptions | None = None) -> Recorded:
    """Log the corridor's run to a file."""
    with open_sinks(save=path, name="corridor") as sink:
        stream = replay_stream(corridor.recording, corridor.config, sink, options)
        steps = []
        for step in corridor.steps():
            stream.log(step)
            steps.append(step)
        stream.finish(corridor.result(steps))
    return Recorded(path, corridor, steps, stream.left_out)


@pytest.fixture(scope="session")
def recorded(corridor: Corridor, tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    """The corridor with everything, as a file."""
    return record(corridor, tmp_path_factory.mktemp("recorded") / "corridor.rrd")


@pytest.fixture(scope="session")
def make_recording() -> Callable[..., Recorded]:
    """A function that records a corridor: (corridor, path, options)."""
    return record


@dataclass(frozen=True)
class View:
    """A view of the layout: its title, Rerun's name of its kind, and the entities that it shows."""

    name: str
    kind: str
    contents: set[str]


@dataclass
class Readable:
    """A .rrd read back: rows by entity, and what ``rerun rrd verify`` says."""

    path: Path

    def __post_init__(self) -> None:
        from rerun.chunk import RrdReader

        self._reader = RrdReader(str(self.path))
        self.entities = {chunk.entity_path.lstrip("/") for chunk in self._reader.stream()}

    def rows(self, entity: str) -> list[dict[str, Any]]:
        """Every row of an entity: ``step`` (None where static) and its components by their short names."""
        out = []
        for chunk in self._reader.stream().filter(content=f"/{entity}"):
            if chunk.entity_path.lstrip("/") != entity:
                continue
            for row in chunk.to_record_batch().to_pylist():
                values = {name.split(":")[-1]: value for name, value in row.items() if "RowId" not in name}
                values.setdefault("step", None)
                out.append(values)
        return out

    def chunks(self, entity: str) -> list[int]:
        """How many rows with a step each chunk of an entity holds, in the file's order."""
        found = self._reader.stream().filter(content=f"/{entity}")
        batches = [c.to_record_batch() for c in found if c.entity_path.lstrip("/") == entity]
        return [batch.num_rows for batch in batches if "step" in batch.schema.names]

    def temporal(self, entity: str) -> list[dict[str, Any]]:
        """The rows that have a step, in its order; the one logged last where several share it."""
        rows = {row["step"]: row for row in self.rows(entity) if row["step"] is not None}
        return [rows[step] for step in sorted(rows)]

    def static(self, entity: str, component: str) -> Any:
        """The last static value of a component."""
        return [row[component] for row in self.rows(entity) if row["step"] is None and row.get(component)][-1]

    def views(self) -> list[View]:
        """The views of the layout; the one sent before the run and the final one differ in framing alone."""
        found: dict[str, dict[str, Any]] = {}
        for chunk in self._reader.stream(store=self._reader.blueprints()[-1]):
            found.setdefault(chunk.entity_path, {}).update(chunk.to_record_batch().to_pylist()[-1])
        views = []
        for path, parts in found.items():
            if "ViewBlueprint:space_origin" in parts:
                (origin,) = parts["ViewBlueprint:space_origin"]
                queries = found[f"{path}/ViewContents"]["ViewContents:query"]
                contents = {query.replace("$origin", origin).lstrip("+ /") for query in queries}
                name, kind = parts["ViewBlueprint:display_name"], parts["ViewBlueprint:class_identifier"]
                views.append(View(name[0], kind[0], contents))
        return views

    def eye(self) -> tuple[Array, Array]:
        """Where the eye of the final layout's 3-D view is, and what it looks at."""
        found: list[dict[str, Any]] = []
        for store in self._reader.blueprints():  # in no order
            for chunk in self._reader.stream(store=store):
                if chunk.entity_path.endswith("/EyeControls3D"):
                    found += chunk.to_record_batch().to_pylist()
        final = max(found, key=lambda row: row["log_time"])
        return np.array(final["EyeControls3D:position"][0]), np.array(final["EyeControls3D:look_target"][0])

    def verify(self) -> str:
        done = subprocess.run(
            [viewer_binary(), "rrd", "verify", self.path], capture_output=True, text=True, check=False
        )
        return done.stdout + done.stderr


@pytest.fixture(scope="session")
def read_back() -> type[Readable]:
    """Reads a .rrd file."""
    return Readable


@pytest.fixture(scope="session")
def demo(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The demo's recording file, made as a user makes it."""
    folder = tmp_path_factory.mktemp("demo")
    command = [sys.executable, "-m", "pfslam_viz", "replay", "demo", "--data", str(folder), "--quiet"]
    subprocess.run([*command, "--save", str(folder / "demo.rrd")], check=True, timeout=300)
    return folder / "demo.rrd"


@pytest.fixture(scope="session")
def output(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where pictures are kept."""
    chosen = os.environ.get("PFSLAM_TEST_OUTPUT")
    folder = Path(chosen) if chosen else tmp_path_factory.mktemp("pictures")
    folder.mkdir(parents=True, exist_ok=True)
    return folder


@pytest.fixture(scope="session")
def shares() -> Callable[[Path], dict[str, float]]:
    """Share of a picture's pixels by colour: white floor, unknown background, the trajectories' colours."""

    def count(picture: Path) -> dict[str, float]:
        image = np.asarray(cv2.imread(str(picture)), int)[..., ::-1]
        colors = {"white": (255, 255, 255), "unknown": BACKGROUND, "orange": (213, 94, 0), "blue": (0, 110, 220)}
        return {name: float(np.mean(np.abs(image - c).max(axis=2) < 25)) for name, c in colors.items()}

    return count
