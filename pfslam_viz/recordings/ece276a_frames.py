"""The Kinect's part of the course's sets: KinectN.npz and dataRGBD/."""

import os
from pathlib import Path

from pfslam_viz.errors import InputError
from pfslam_viz.recordings import npz
from pfslam_viz.recordings.recording import Frames, Stream
from pfslam_viz.recordings.stamps import order
from pfslam_viz.robot import Robot

KINECT = "Kinect"


def read_frames(folder: Path, number: str, robot: Robot, notes: list[str]) -> tuple[Frames | None, tuple[Stream, ...]]:
    """The Kinect's images of set ``number``, None if there are none, and its streams of stamps.

    What is wrong with them costs the images, not the recording, and is added to ``notes``. ``folder`` holds the
    ``.npz`` files; ``dataRGBD/`` lies beside them or up to two folders above.
    """
    path = folder / f"{KINECT}{number}.npz"
    camera = robot.ground_camera()
    if not path.exists():
        return None, ()
    try:
        arrays = npz.read_arrays(path, ["rgb_time_stamps", "disparity_time_stamps"])
        color_stamps = npz.vector(arrays, "rgb_time_stamps", path)
        disparity_stamps = npz.vector(arrays, "disparity_time_stamps", path)
    except InputError as error:
        notes.append(f"camera: left out; {error}")
        return None, ()
    color_paths = _images(folder, f"RGB{number}", f"rgb{number}_", len(color_stamps), notes)
    disparity_paths = _images(folder, f"Disparity{number}", f"disparity{number}_", len(disparity_stamps), notes)
    kept = order(color_stamps, "colour frames", notes)
    color_stamps, color_paths = color_stamps[kept], tuple(color_paths[k] for k in kept)
    kept = order(disparity_stamps, "disparity frames", notes)
    disparity_stamps, disparity_paths = disparity_stamps[kept], tuple(disparity_paths[k] for k in kept)
    streams = (Stream("disparity frames", disparity_stamps), Stream("colour frames", color_stamps))
    color, disparity = (sum(p is not None for p in paths) for paths in (color_paths, disparity_paths))
    if color == disparity == 0:
        notes.append(f"camera: {path.name} has stamps, but there are no images in dataRGBD/ beside or above {folder}")
        return None, streams
    for what, have, stamps in (("colour", color, color_stamps), ("disparity", disparity, disparity_stamps)):
        if have < len(stamps):
            notes.append(f"camera: {have} of {len(stamps)} {what} frames are here")
    if camera is None:
        notes.append("camera: the robot file has no camera; the images are left out")
        return None, streams
    return Frames(color_stamps, color_paths, disparity_stamps, disparity_paths, camera), streams


def _images(folder: Path, subfolder: str, prefix: str, count: int, notes: list[str]) -> tuple[Path | None, ...]:
    """Paths of images 1 to ``count``, None for those that are not there. One listing, not a look per file."""
    for place in (folder, folder.parent, folder.parent.parent):
        images = place / "dataRGBD" / subfolder
        if images.is_dir():
            there = set(os.listdir(images))  # noqa: PTH208
            break
    else:
        return (None,) * count
    names = [f"{prefix}{k}.png" for k in range(1, count + 1)]
    known = set(names)
    if extra := sum(name.startswith(prefix) and name.endswith(".png") and name not in known for name in there):
        notes.append(f"camera: {extra} images in {subfolder} have no time stamp; left out")
    return tuple(images / name if name in there else None for name in names)
