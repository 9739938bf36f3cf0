from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.config import load_robot
from pfslam_viz.recordings.ece276a import load
from pfslam_viz.recordings.recording import Frames, Recording
from pfslam_viz.settings import TextureConfig
from pfslam_viz.simulation.buildings import build
from pfslam_viz.simulation.drive import DriveConfig, drive_along
from pfslam_viz.simulation.floor import CHECKER, TILE
from pfslam_viz.simulation.recording import simulate
from pfslam_viz.simulation.world import World
from pfslam_viz.texture import painter as painter_module
from pfslam_viz.texture.floor_texture import FloorTexture
from pfslam_viz.texture.kinect import FloorView
from pfslam_viz.texture.painter import TexturePainter, pair

CELL = 0.07
Colors = Callable[[World, NDArray[np.float64]], NDArray[np.float64]]


def test_pair_takes_the_nearest_disparity_frame() -> None:
    pairs = pair([0.00, 0.10, 0.16, 0.50], [0.01, 0.11, 0.21, 0.60])
    # 0.16 lies half way between 0.11 and 0.21, as far as binary fractions can: either neighbour.
    assert pairs[[0, 1, 3]].tolist() == [[0, 0], [1, 1], [3, 3]] and pairs[2, 1] in (1, 2)
    assert pair([1.0, 2.0, 3.0], [2.1]).tolist() == [[1, 0]]  # 1.1 and 0.9 s are too far apart
    assert pair([], [1.0]).shape == pair([1.0], []).shape == (0, 2)


def write(path: Path, image: np.ndarray) -> Path:
    assert cv2.imwrite(str(path), image)
    return path


def frames_of(folder: Path, stamps: list[float], **replaced: dict[int, Path | None]) -> Frames:
    camera = load_robot("ece276a-paper").ground_camera()
    assert camera is not None
    color = write(folder / "color.png", np.full((480, 640, 3), (30, 20, 10), np.uint8))  # BGR on disk
    disparity = write(folder / "disparity.png", np.full((480, 640), 712, np.uint16))
    paths: dict[str, list[Path | None]] = {"color": [color] * len(stamps), "disparity": [disparity] * len(stamps)}
    for what, others in replaced.items():
        for index, path in others.items():
            paths[what][index] = path
    at = np.array(stamps)
    return Frames(at, tuple(paths["color"]), at + 0.01, tuple(paths["disparity"]), camera)


def test_the_pose_is_interpolated_at_the_disparity_stamp(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    painter = TexturePainter(frames_of(tmp_path, [0.99, 1.24, 1.49]), TextureConfig(), CELL)
    seen: list[tuple[list[float], list[int]]] = []

    def add(self: FloorTexture, disparity: np.ndarray, color: np.ndarray, pose: np.ndarray, plane: None) -> int:
        seen.append((pose.tolist(), color[0, 0].tolist()))
        return 0

    monkeypatch.setattr(FloorTexture, "add_cropped", add)
    assert painter.add_pose(1.0, (0.0, 0.0, 3.0)) == (0, 0)  # taken at the very stamp of the scan
    assert painter.add_pose(1.2, (0.4, 0.2, 3.1)) is None
    assert painter.add_pose(1.3, (0.6, 0.2, -3.1)) == (1, 1)
    assert painter.add_pose(1.7, (1.0, 0.6, -3.0)) == (2, 2)
    painter.finish()
    poses = [pose for pose, _ in seen]
    assert poses[0] == pytest.approx([0.0, 0.0, 3.0])
    assert poses[1] == pytest.approx([0.5, 0.2, -np.pi])  # half way, over the seam of the heading
    assert poses[2] == pytest.approx([0.8, 0.4, -3.05])
    assert all(color == [10, 20, 30] for _, color in seen)  # RGB
    assert painter.painted == 3 and painter.skipped.total == 0


def test_unusable_frames_are_skipped_and_counted(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    speckle = np.random.default_rng(0).integers(0, 255, (480, 640, 3), np.uint8)
    whole = write(tmp_path / "whole.png", speckle).read_bytes()
    (tmp_path / "cut.png").write_bytes(whole[: len(whole) // 2])
    (tmp_path / "damaged.png").write_bytes(whole[:5000] + b"\0" * 4000 + whole[9000:])
    (tmp_path / "empty.png").write_bytes(b"")
    small = write(tmp_path / "small.png", np.zeros((240, 320, 3), np.uint8))
    shallow = write(tmp_path / "shallow.png", np.zeros((480, 640), np.uint8))
    frames = frames_of(
        tmp_path,
        [0.5 + k for k in range(10)],
        color={1: None, 2: tmp_path / "gone.png", 3: tmp_path / "cut.png", 4: tmp_path / "damaged.png", 5: small},
        disparity={6: None, 7: tmp_path / "empty.png", 8: shallow},
    )
    painter = TexturePainter(frames, TextureConfig(), CELL)
    painted = [painter.add_pose(t, (t, 0.0, 0.0)) for t in np.arange(1.0, 9.8, 0.1)]
    painter.finish()
    # Frame 0 was taken before the first pose and frame 9 after the last one but for 0.1 s: 9.51 <= 9.7.
    skipped = painter.skipped
    assert (skipped.missing, skipped.unreadable, skipped.wrong, skipped.without_pose) == (3, 3, 2, 1)
    assert painter.painted == 1 and [p for p in painted if p] == [(9, 9)]
    assert str(skipped) == "3 missing, 3 unreadable, 2 wrong, 1 without pose"
    assert capfd.readouterr().err == ""  # and nothing complains on the terminal


def test_frames_after_the_last_pose_have_none(tmp_path: Path) -> None:
    painter = TexturePainter(frames_of(tmp_path, [0.5, 1.5, 2.5]), TextureConfig(), CELL)
    painter.add_pose(0.0, (0.0, 0.0, 0.0))
    painter.add_pose(1.0, (0.0, 0.0, 0.0))
    painter.finish()
    painter.finish()
    assert (painter.painted, painter.skipped.without_pose) == (1, 2)


@pytest.fixture(scope="module")
def office(tmp_path_factory: pytest.TempPathFactory) -> tuple[Recording, World]:
    """The first seconds of a drive through an office, and the building in the frame of the first pose."""
    folder = simulate(tmp_path_factory.mktemp("office") / "recording", seed=9, duration=16.0)
    plan_rng, drive_rng = (np.random.default_rng(s) for s in np.random.SeedSequence(9).spawn(6)[:2])
    world = build("office", plan_rng)
    return load(folder), world.seen_from(drive_along(world.route, drive_rng, DriveConfig(), 16.0).poses[0])


def true_colors(
    floor_colors: Colors, world: World, texture: FloorTexture, cells: np.ndarray, shift: tuple[float, float] = (0, 0)
) -> np.ndarray:
    """(n, 3) mean colour of the simulated floor over each cell (n, 2), displaced by ``shift`` cells down and right."""
    total = np.zeros((len(cells), 3))
    parts = (1 / 6, 3 / 6, 5 / 6)
    for down in parts:
        for right in parts:
            y = (texture.origin[0] - cells[:, 0] - shift[0] - down) * CELL
            x = (cells[:, 1] + shift[1] - texture.origin[1] + right) * CELL
            total += floor_colors(world, np.stack([x, y], axis=-1))
    return total / len(parts) ** 2


def test_the_painted_floor_is_the_simulated_one(office: tuple[Recording, World], floor_colors: Colors) -> None:
    recording, world = office
    assert recording.truth is not None and recording.frames is not None
    painter = TexturePainter(recording.frames, TextureConfig(), CELL)
    for stamp, pose in zip(recording.truth.stamps, recording.truth.poses, strict=True):
        painter.add_pose(stamp, pose)
    painter.finish()
    texture = painter.texture
    assert painter.skipped.total == 0 and painter.painted == len(recording.frames.color_stamps) > 25

    cells = np.argwhere(texture.weight)
    true = true_colors(floor_colors, world, texture, cells)
    on_floor = (true > 60).all(axis=1)  # not the feet of walls
    assert len(cells) > 4000 and on_floor.mean() > 0.9
    error = np.abs(texture.color[cells[:, 0], cells[:, 1]] - true)[on_floor].mean(axis=1)
    assert error.mean() < 4.0 and np.percentile(error, 90) < 12.0  # of 255

    # Every corner of four tiles that was seen all round: where does the painted neighbourhood fit the floor best?
    view = geometry.inverse(world.plan)
    centers = np.stack([(cells[:, 1] - texture.origin[1] + 0.5), (texture.origin[0] - cells[:, 0] - 0.5)], -1) * CELL
    on_plan = geometry.transform(view, centers)
    zone = world.zones[0]
    assert world.floors[0] == CHECKER
    near = {
        (i, j): np.flatnonzero(np.abs(on_plan - [i * TILE, j * TILE]).max(axis=1) < 0.2)
        for i in range(int(np.ceil(zone[0] / TILE)) + 1, int(zone[2] / TILE))
        for j in range(int(np.ceil(zone[1] / TILE)) + 1, int(zone[3] / TILE))
    }
    weights = texture.weight[cells[:, 0], cells[:, 1]]
    corners = [these for these in near.values() if len(these) >= 28 and weights[these].min() >= 10]
    painted = texture.color[cells[:, 0], cells[:, 1]]
    shifts = [(a / 4, b / 4) for a in range(-6, 7) for b in range(-6, 7)]
    looked_at = np.unique(np.concatenate(corners))  # colours of the simulated floor take time
    misfit = np.zeros((len(shifts), len(cells)))
    for k, shift in enumerate(shifts):
        there = true_colors(floor_colors, world, texture, cells[looked_at], shift)
        misfit[k, looked_at] = ((painted[looked_at] - there) ** 2).sum(axis=1)
    offsets = [shifts[int(misfit[:, these].sum(axis=1).argmin())] for these in corners]
    distance = np.hypot(*np.array(offsets).T)  # in cells
    assert len(distance) >= 15
    assert np.median(distance) <= 0.5 and distance.max() < 1.0


def test_repainting_along_the_same_poses_gives_the_same_floor(office: tuple[Recording, World]) -> None:
    recording, _ = office
    assert recording.truth is not None and recording.frames is not None
    first = Frames(
        recording.frames.color_stamps[:6], recording.frames.color_paths[:6], recording.frames.disparity_stamps,
        recording.frames.disparity_paths, recording.frames.camera,
    )  # fmt: skip
    painter = TexturePainter(first, TextureConfig(), CELL)
    for stamp, pose in zip(recording.truth.stamps, recording.truth.poses, strict=True):
        painter.add_pose(stamp, pose)
    painter.finish()
    again = painter.repaint(recording.truth.stamps, recording.truth.poses)
    assert again.frames == 6 and np.array_equal(again.color, painter.texture.color)
    turned = painter.repaint(recording.truth.stamps, recording.truth.poses + np.array([0.0, 0.0, 1.0]))
    assert not np.array_equal(turned.color, painter.texture.color)


@pytest.mark.parametrize("keep, room, read_again", [(True, 10, 0), (True, 3, 4), (False, 10, 7)])
def test_kept_images_are_not_read_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, keep: bool, room: int, read_again: int
) -> None:
    """Seven pairs, with room for all of them, for some, or not wanted."""
    read: list[Path | None] = []
    original = painter_module.read_images

    def counted(color: Path | None, disparity: Path | None, view: FloorView) -> painter_module.Images:
        read.append(color)
        return original(color, disparity, view)

    monkeypatch.setattr(painter_module, "read_images", counted)
    monkeypatch.setattr(painter_module, "KEPT_BYTES", room * (355 * 2 + 339 * 3) * 640)  # the rows that are used
    stamps = np.arange(0.5, 7.0)
    painter = TexturePainter(frames_of(tmp_path, stamps.tolist()), TextureConfig(), CELL, keep=keep)
    poses = np.array([[0.3 * k, 0.0, 0.1 * k] for k in range(8)])
    for stamp, pose in enumerate(poses):
        painter.add_pose(stamp, pose)
    painter.finish()
    assert len(read) == 7
    again = painter.repaint(np.arange(8.0), poses)
    assert len(read) == 7 + read_again and again.frames == 7
    np.testing.assert_array_equal(again.color, painter.texture.color)


def test_twin21_is_painted(shared_data: Path) -> None:
    recording = load(shared_data / "twin21")
    assert recording.truth is not None and recording.frames is not None
    painter = TexturePainter(recording.frames, TextureConfig(), CELL)
    for stamp, pose in zip(recording.truth.stamps[:1600], recording.truth.poses, strict=False):
        painter.add_pose(stamp, pose)
    painter.finish()
    assert painter.painted + painter.skipped.without_pose == 183 and painter.painted == painter.texture.frames > 50
    seen = painter.texture.weight > 0
    assert 40.0 < seen.sum() * CELL**2 < 130.0  # 25 m of a hallway of over 2 m
    # Tiles of two colours: neighbouring cells mostly agree, which they would not if the frames were smeared.
    both = seen[:, 1:] & seen[:, :-1]
    step = np.abs(np.diff(painter.texture.color.astype(int), axis=1)).max(axis=2)[both]
    assert (step < 12).mean() > 0.7 and (step > 40).mean() > 0.02
