"""The course's sets as the catalog sees them: several files make a recording, and a folder may hold several."""

from pathlib import Path

from pfslam_viz.config import load_robot
from pfslam_viz.errors import InputError
from pfslam_viz.recordings import ece276a, npz
from pfslam_viz.recordings.formats import Format, Glance, LoadOptions, Place, Reader, WithoutScans
from pfslam_viz.recordings.recording import Recording
from pfslam_viz.recordings.robot_beside import robot_of

_SENSORS = {"Hokuyo": "lidar", "Encoders": "encoders", "Imu": "IMU", "Kinect": "colour and disparity"}


class SetReader(Reader):
    """A set is a number and the files that end in it, in a folder or in ``data/`` below it."""

    def load(self, place: Place, options: LoadOptions) -> Recording:
        """As :func:`pfslam_viz.recordings.ece276a.load`."""
        robot = None if options.robot is None else load_robot(options.robot)
        return ece276a.load(place.path, place.number, robot, place.name)

    def find(self, folder: Path, row: Format) -> list[Place]:
        """The sets in the folder and in ``data/`` below; of one that is in both, the more complete half."""
        numbers = sorted({n for where in (folder, folder / "data") for n in ece276a.sets_in(where)}, key=int)
        found = [(number, ece276a.find_set(folder, number)) for number in numbers]
        return [_place(where, number, row) for number, where in found if where is not None]

    def place(self, path: Path, row: Format) -> Place:
        """The set that one of its files belongs to."""
        return _place(path.parent, row.name_of(path), row)

    def missing(self, place: Place) -> list[str]:
        """Those of the three files of every set that are not there."""
        return ece276a.missing_files(place.path, place.number or "")

    def needs(self, name: str) -> list[str]:
        """The three files of a set, for a number."""
        return [f"{kind}{name}.npz" for kind in ece276a.REQUIRED] if name.isdigit() else []

    def glance(self, place: Place) -> Glance:
        """From the names of the files, and the lidar's stamps."""
        number = place.number or ""
        kinds = ece276a.sets_in(place.path).get(number, set())
        sensors = ", ".join(word for kind, word in _SENSORS.items() if kind in kinds)
        if any((place.path / name).exists() for name in ("ground_truth.npz", f"ground_truth{number}.npz")):
            sensors += ", truth"
        if "Hokuyo" not in kinds:
            return Glance(sensors, "")
        path = place.path / f"Hokuyo{number}.npz"
        try:
            stamps = npz.vector(npz.read_arrays(path, ["time_stamps"]), "time_stamps", path)
        except InputError:
            return Glance(sensors, "", f"{path.name} is damaged")
        if len(stamps) == 0:
            return Glance(sensors, "empty")
        return Glance(sensors, f"{stamps.max() - stamps.min():,.0f} s, {len(stamps):,} scans")

    def without_scans(self, place: Place, options: LoadOptions) -> WithoutScans | None:
        """Dead reckoning at the encoders' stamps, of a set that lacks just its lidar's file.

        Raises InputError when the encoders' or the IMU's file is damaged.
        """
        lidar = f"Hokuyo{place.number}.npz"
        if self.missing(place) != [lidar]:
            return None
        number = place.number or ""
        robot = robot_of(place.path, number) if options.robot is None else load_robot(options.robot)
        sensors = ece276a.read_sensors(place.path, number, robot)
        trajectory = sensors.odometry.dead_reckoning()
        notes = [f"{lidar} is not here: there are no scans, so it cannot be replayed", *sensors.notes]
        early = float(trajectory.stamps[-1]) - float(sensors.odometry.gyro_stamps[-1])
        if early > 0.1:
            notes.append(f"IMU: ends {early:.2f} s before the encoders; taken to rest from then on")
        return WithoutScans(sensors.streams, trajectory, sensors.odometry.path_length(), tuple(notes))


def _place(folder: Path, number: str, row: Format) -> Place:
    return Place(number, folder, row.name, number, folder / f"Hokuyo{number}.npz")


READER = SetReader()
