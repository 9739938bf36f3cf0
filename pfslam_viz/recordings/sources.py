"""The recordings that have a name: what they are, and where the public ones come from."""

from dataclasses import dataclass

_SETS = "yschen13/SLAM_ParticleFilter/daed3ccc7454d2f48d0aa7637e1075d90cc5f5be"
_FRAMES = "llu0120/Particle-Filter-SLAM/59ccf8f9aff9add34bad530db80339481e5f568e/dataRGBD"
_LOGS = "MOLAorg/mola_test_datasets/13a2ed141116bc654e14ffca1d88fb740b3d1253/datasets/radish"
_RELATIONS = "xiaofeng419/SLAM-2D-LIDAR-SCAN/d469252f5b33e574bd239ad2625779497ac1d4cc/DataSet/RawData"

_SET_NOTICE = f"""\
Set {{name}} of the course ECE276A (UC San Diego), earlier ESE650 (University of Pennsylvania).

The files are given without a licence: they were fetched for your own use and must not be redistributed.

Sensors: https://github.com/{_SETS.replace("/daed", "/tree/daed")}
Colour and disparity images, where fetched: https://github.com/{_FRAMES.replace("/59cc", "/tree/59cc")}
"""

_LOG_NOTICE = f"""\
CARMEN log {{name}} of the public SLAM benchmark, {{credit}}.

Licence: Creative Commons Attribution 3.0 (https://creativecommons.org/licenses/by/3.0/). If you publish something made
with it, name its authors and: R. Kuemmerle, B. Steder, C. Dornhege, M. Ruhnke, G. Grisetti, C. Stachniss, A. Kleiner:
On measuring the accuracy of SLAM algorithms. Autonomous Robots 27 (2009), which gave the relations.

Log: https://github.com/{_LOGS.replace("/13a2", "/tree/13a2")}
Relations, where there are any: there, or https://github.com/{_RELATIONS.replace("/d469", "/tree/d469")}
"""


@dataclass(frozen=True, slots=True)
class RemoteFile:
    """One file: its name here, ``owner/repository/commit/path`` there, and its digest.

    ``digest`` is ``sha256:...`` or ``git:...``, a git blob id; None where no digest is known.
    """

    name: str
    path: str
    digest: str | None = None


@dataclass(frozen=True, slots=True)
class Source:
    """One recording that has a name.

    Attributes:
        name: what the user calls it.
        format: ``"ece276a"`` or ``"carmen"``.
        length: duration and scans, in words.
        sensors: in words.
        size: of the download, in words; ``""`` if there is none.
        files: what to fetch.
        frames: how many colour and disparity images can be fetched besides.
        notice: licence and origin, to be kept beside the data.
    """

    name: str
    format: str
    length: str
    sensors: str
    size: str = ""
    files: tuple[RemoteFile, ...] = ()
    frames: tuple[int, int] = (0, 0)
    notice: str = ""

    def color_frame(self, k: int) -> RemoteFile:
        """Colour image ``k``, from 1."""
        return self._frame(f"RGB{self.name}/rgb{self.name}_{k}.png")

    def disparity_frame(self, k: int) -> RemoteFile:
        """Disparity image ``k``, from 1."""
        return self._frame(f"Disparity{self.name}/disparity{self.name}_{k}.png")

    def _frame(self, path: str) -> RemoteFile:
        return RemoteFile(f"dataRGBD/{path}", f"{_FRAMES}/{path}")


def _set(name: str, length: str, blobs: dict[str, str], frames: tuple[int, int] = (0, 0)) -> Source:
    files = tuple(
        RemoteFile(f"{kind}{name}.npz", f"{_SETS}/{kind}{name}.npz", f"git:{blob}") for kind, blob in blobs.items()
    )
    sensors = "lidar, encoders, IMU" + (", colour and disparity" if frames[0] else "")
    return Source(name, "ece276a", length, sensors, "12 MB", files, frames, _SET_NOTICE.format(name=name))


def _log(name: str, length: str, size: str, credit: str, *files: RemoteFile) -> Source:
    relations = any(file.name.endswith(".relations") for file in files)
    sensors = "lidar, odometry" + (", relations" if relations else "")
    notice = _LOG_NOTICE.format(name=name, credit=credit)
    return Source(name, "carmen", length, sensors, size, files, notice=notice)


SOURCES: dict[str, Source] = {
    source.name: source
    for source in (
        Source("demo", "ece276a", "", "lidar, encoders, IMU, colour and disparity, truth"),
        _set(
            "20",
            "124 s, 4,962 scans",
            {
                "Encoders": "a7f9812d8fd85704bbd575f84cb611ef998fb04e",
                "Hokuyo": "90161a62b97202c5c2c640777aa8c40b1e5d6ac2",
                "Imu": "9946a69924fd5b261901bd8b18bfd44dcb238e39",
                "Kinect": "59ae2fa01f171001df3629f121d31c9e6a16fb3f",
            },
            (2289, 2407),
        ),
        _set(
            "21",
            "119 s, 4,785 scans",
            {
                "Encoders": "7ec129ad28ccc1c549c8e05e0508d6c15579f6b2",
                "Hokuyo": "975c5dc9125446b66affc7e9c81933ff8b823036",
                "Imu": "93db605974adc1c2c9fc7459a35f7fb12f87c297",
                "Kinect": "8dcd5458ae6dff954f95d058dce7ca251d5b0141",
            },
            (2112, 2188),
        ),
        _set(
            "23",
            "95 s",
            {
                "Encoders": "ab5d8ea73d967d43b870a43ab1cb77faf8f486f9",
                "Hokuyo": "16513aa1a17c1b6f56692f2b2ad8026621608365",
                "Imu": "5ae72499bebe1d9dbbbd8687be0c015f409132e7",
            },
        ),
        _log(
            "intel",
            "2,691 s, 13,631 scans",
            "2.5 MB",
            "Intel Research Lab, Seattle, by Dirk Haehnel",
            RemoteFile(
                "intel.clf.bz2",
                f"{_LOGS}/intel.clf.bz2",
                "sha256:d9ce4addefc9405d5e78fd883d2214766552537d262009f8e6f0137885f9f72a",
            ),
            RemoteFile(
                "intel.relations",
                f"{_RELATIONS}/intel.relations",
                "sha256:330378f153eeae652d6756c1746f335801f66c3e097d90611548e6c4f593c359",
            ),
        ),
        _log(
            "fr079",
            "1,061 s, 4,934 scans",
            "1.7 MB",
            "building 079, University of Freiburg, by Cyrill Stachniss",
            RemoteFile(
                "fr079.clf.bz2",
                f"{_LOGS}/fr079.clf.bz2",
                "sha256:9c3930e17957889c24986390dc7fe3eeddd3d7019a8172085dbed8a28a0e6b77",
            ),
            RemoteFile(
                "fr079.relations",
                f"{_RELATIONS}/fr079.relations",
                "sha256:7e7f06b4aca455cb68f1f23d04e7c7316c5e17773e872734c860ed7a274cdfc7",
            ),
        ),
        _log(
            "aces",
            "1,366 s, 7,374 scans",
            "0.9 MB",
            "ACES building, University of Texas at Austin, by Patrick Beeson",
            RemoteFile(
                "aces.clf.bz2",
                f"{_LOGS}/aces.clf.bz2",
                "sha256:b663e2976ed0621c2bec0cc20c4e7cc117b88db5bac6f921d3fbaa9685d2232a",
            ),
            RemoteFile(
                "aces.relations",
                f"{_LOGS}/aces.relations",
                "sha256:11a15800a751b6f9413078a021d49c7cda85a768c2a465433b4fae7ef57b03d5",
            ),
        ),
        _log(
            "mit-csail",
            "424 s, 1,988 scans",
            "0.5 MB",
            "MIT CSAIL, 3rd floor, by Cyrill Stachniss",
            RemoteFile(
                "mit-csail.clf.bz2",
                f"{_LOGS}/mit-csail.clf.bz2",
                "sha256:e010703e450a20e71a97b0e8de88d9474040c8106e547ff894d885e67a309b47",
            ),
        ),
        _log(
            "fr-clinic",
            "4,820 s, 6,917 scans",
            "1.7 MB",
            "University hospital, Freiburg, by Bastian Steder and Rainer Kuemmerle",
            RemoteFile(
                "fr-clinic.clf.bz2",
                f"{_LOGS}/fr-clinic_robotlaser.clf.bz2",
                "sha256:f1123753be7308178547d487df96dfc230669a55c21253c3225c7627b124d6d8",
            ),
        ),
    )
}
