"""Files damaged at random: a Recording or one line that names the file, in bounded time and memory; nothing else."""

import bz2
import gzip
import io
import tracemalloc
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import pfslam_viz as pf

SCANS, BEAMS = 5, 9
MOST_MEMORY = 200e6  # bytes, over what the largest of these files needs, a few kB, by far
LONGEST = 60_000  # ms; for a file of a few kB: what hangs is caught, what is slow under load is not

NASTY = (
    "nan", "inf", "-inf", "-1", "0", "1e308", "-1e308", "1e-320", "99999999", "4294967296", "9223372036854775808",
    "1e19", "0x10", "1_000", "1,5", "٣", "½", "", "\x00", "\ufeff", "\ud7ff", "FLASER", "ROBOTLASER1", "PARAM", "#",
    "\r", "laser_front_laser_resolution", "1.5.2", "--", "%s%n", "1" * 400,
)  # fmt: skip


def log(kind: str) -> str:
    """A CARMEN log of a robot that drives ahead between walls, by one kind of laser message."""
    lines = ["# a log", "PARAM robot_front_laser_max 81.9", "PARAM robot_frontlaser_offset 0.1", "# message_name [m]"]
    for k in range(SCANS):
        x, stamp = 0.2 * k, 976052857.3 + 0.2 * k
        ranges = " ".join(f"{2.0 + 0.1 * b - 0.05 * k:.2f}" for b in range(BEAMS))
        end = f"{stamp:.6f} host {0.2 * k:.6f}"
        lines.append(f"ODOM {x} 0 0.01 0.5 0 0 {end}")
        if kind == "FLASER":
            lines.append(f"FLASER {BEAMS} {ranges} {x + 0.1} 0 0.01 {x} 0 0.01 {end}")
        elif kind == "ROBOTLASER1":
            pose = f"{x + 0.1} 0 0.01 {x} 0 0.01 0.5 0 0.3 0.4 1000"
            lines.append(f"ROBOTLASER1 0 -1.57 3.14 {3.14 / (BEAMS - 1):.4f} 30 0.01 0 {BEAMS} {ranges} 0 {pose} {end}")
        else:
            lines.append(f"RAWLASER1 0 -1.57 3.14 {3.14 / (BEAMS - 1):.4f} 30 0.01 0 {BEAMS} {ranges} 0 {end}")
    return "\n".join(lines) + "\n"


@st.composite
def damaged_logs(draw: st.DrawFn) -> bytes:
    """A log whose words, lines or bytes were changed, taken out, doubled or cut, packed or not."""
    lines = [
        line.split(" ") for line in log(draw(st.sampled_from(["FLASER", "ROBOTLASER1", "RAWLASER1"]))).splitlines()
    ]
    for _ in range(draw(st.integers(0, 6))):
        line = draw(st.sampled_from(lines))
        at = draw(st.integers(0, max(len(line) - 1, 0)))
        change = draw(st.sampled_from(["word", "word", "delete", "double", "line", "drop", "column"]))
        if change == "word" and line:
            line[at] = draw(st.sampled_from(NASTY) | st.text(max_size=8))
        elif change == "delete":
            del line[at : at + draw(st.integers(1, 12))]
        elif change == "double":
            line[at:at] = line[at : at + draw(st.integers(1, 12))]
        elif change == "line":
            lines.insert(draw(st.integers(0, len(lines))), list(line))
        elif change == "drop" and len(lines) > 1:
            lines.remove(line)
        elif change == "column":
            nasty = draw(st.sampled_from(NASTY))
            for other in lines:
                if len(other) > 4:
                    other[min(at, len(other) - 1)] = nasty
    text = "\n".join(" ".join(line) for line in lines)
    data = text.encode(draw(st.sampled_from(["utf-8", "utf-8-sig", "utf-16", "latin-1"])), "replace")
    packing = draw(st.sampled_from(["plain", "plain", "gzip", "bzip2"]))
    if packing != "plain":
        data = gzip.compress(data) if packing == "gzip" else bz2.compress(data)
    return damaged(draw, data)


def damaged(draw: st.DrawFn, data: bytes) -> bytes:
    """Bytes of which some may be flipped, cut off or put in."""
    for _ in range(draw(st.integers(0, 3))):
        at = draw(st.integers(0, max(len(data) - 1, 0)))
        change = draw(st.sampled_from(["flip", "cut", "insert", "remove", "double"]))
        if change == "flip" and data:
            data = data[:at] + bytes([data[at] ^ draw(st.integers(1, 255))]) + data[at + 1 :]
        elif change == "cut":
            data = data[:at]
        elif change == "insert":
            data = data[:at] + draw(st.binary(min_size=1, max_size=9)) + data[at:]
        elif change == "remove":
            data = data[:at] + data[at + draw(st.integers(1, 60)) :]
        elif change == "double":
            data = data[:at] + data[max(0, at - 60) :]
    return data


def course_set() -> dict[str, dict[str, Any]]:
    """The arrays of one of the course's sets: two wheels a side, gyro, lidar, and the camera's stamps."""
    stamps = 1000.0 + 0.1 * np.arange(SCANS)
    return {
        "Encoders": {"counts": np.full((4, SCANS), 10, np.int16), "time_stamps": stamps},
        "Hokuyo": {
            "ranges": np.full((BEAMS, SCANS), 2.0),
            "angle_min": -0.5,
            "angle_max": np.array([[0.5]]),
            "angle_increment": np.array([[1.0 / (BEAMS - 1)]]),
            "range_min": 0.1,
            "range_max": 30.0,
            "time_stamps": stamps,
        },
        "Imu": {
            "angular_velocity": np.zeros((3, SCANS)),
            "linear_acceleration": np.zeros((3, SCANS)),
            "time_stamps": stamps,
        },
        "Kinect": {"rgb_time_stamps": stamps, "disparity_time_stamps": stamps},
    }


SCALARS = st.sampled_from([np.nan, np.inf, -np.inf, 0.0, -1.0, 1e-320, 1e308, -1e308, 2.0**63, 1e19, 0.5])


KINDS = ("i1", "u1", "i8", "f2", "f4", "?", "c16", "U5", "S3", "M8[s]")


def changes(array: Any) -> st.SearchStrategy[Any]:
    """What a stored array may have been replaced by: other numbers, types, shapes, or no numbers at all."""
    array = np.asarray(array)
    if array.dtype.kind not in "biuf":  # changed before
        array = np.zeros(array.shape)
    cells = st.tuples(st.integers(0, max(array.size - 1, 0)), SCALARS)

    def with_cells(new: list[tuple[int, float]]) -> Any:
        out = array.astype(float).ravel()
        for k, value in new if out.size else ():
            out[k] = value
        return out.reshape(array.shape)

    return st.one_of(
        st.lists(cells, min_size=1, max_size=4).map(with_cells),
        SCALARS.map(lambda value: np.full(array.shape, value)),
        st.sampled_from(KINDS).map(lambda kind: np.clip(np.nan_to_num(array), 0, 99).astype(kind)),
        st.sampled_from([(0,), (1,), (0, 3), (3, 0), (1, 1, 1), (SCANS,), (BEAMS, SCANS), (2, 2)]).map(np.zeros),
        st.just(array.T.copy()),
        st.just(array.ravel()[::-1].copy()),
        st.just(None),
    )


@st.composite
def damaged_sets(draw: st.DrawFn) -> dict[str, bytes]:
    """The files of a set of which some arrays were replaced or left out, and some bytes changed."""
    files = course_set()
    if draw(st.booleans()):
        del files["Kinect"]
    for _ in range(draw(st.integers(0, 3))):
        arrays = files[draw(st.sampled_from(sorted(files)))]
        key = draw(st.sampled_from(sorted(arrays)))
        new = draw(changes(arrays[key]))
        if new is not None:
            arrays[key] = new
        elif len(arrays) > 1:
            del arrays[key]
    out = {}
    for kind, arrays in files.items():
        buffer = io.BytesIO()
        if draw(st.booleans()):
            np.savez_compressed(buffer, **arrays)
        else:
            np.savez(buffer, **arrays)
        out[f"{kind}7.npz"] = buffer.getvalue()
    victim = draw(st.sampled_from(sorted(out)))
    out[victim] = damaged(draw, out[victim])
    return out


def loaded(path: Path) -> pf.Recording | None:
    """The recording, whatever the check says of it; None where it was refused in one line that names the file."""
    tracemalloc.start()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # a user would see them on the terminal
            recording = pf.load_recording(path, force=True)
        assert isinstance(recording, pf.Recording) and recording.checked
        return recording
    except pf.InputError as error:
        message = str(error)
        assert message.splitlines() == [message], "an error is one line"
        assert str(path.parent) in message, "an error names the file"
        return None
    finally:
        _, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        assert peak < MOST_MEMORY


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Callable[[], Path]:
    """An empty folder for every call."""
    return lambda: tmp_path_factory.mktemp("damaged")


@given(data=damaged_logs(), suffix=st.sampled_from([".log", ".clf", ".log.gz", ".clf.bz2"]))
@settings(max_examples=80, deadline=LONGEST)
def test_a_damaged_log_is_read_or_refused(data: bytes, suffix: str, folder: Callable[[], Path]) -> None:
    path = folder() / f"drive{suffix}"
    path.write_bytes(data)
    loaded(path)


@given(files=damaged_sets())
@settings(max_examples=60, deadline=LONGEST)
def test_a_damaged_set_is_read_or_refused(files: dict[str, bytes], folder: Callable[[], Path]) -> None:
    where = folder()
    for name, data in files.items():
        (where / name).write_bytes(data)
    loaded(where / "Hokuyo7.npz")


@pytest.mark.parametrize("kind", ["FLASER", "ROBOTLASER1", "RAWLASER1"])
def test_what_is_damaged_was_sound(kind: str, folder: Callable[[], Path]) -> None:
    """Else the tests above would try nothing but refusals."""
    path = folder() / "drive.log"
    path.write_text(log(kind))
    recording = loaded(path)
    assert recording is not None and recording.ranges.shape == (SCANS, BEAMS)
