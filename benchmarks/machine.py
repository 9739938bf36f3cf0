"""What numbers were measured on."""

import datetime
import os
import platform
from importlib.metadata import version
from pathlib import Path

PACKAGES = ("pfslam-viz", "numpy", "numba", "opencv-python-headless", "rerun-sdk")


def describe() -> str:
    """Machine, versions and date, a line each."""
    system = f"{processor()}, {os.cpu_count()} logical cores, {memory_gb():.0f} GB; {platform.system()}"
    packages = ", ".join(f"{name} {version(name)}" for name in PACKAGES)
    return f"{system}\nPython {platform.python_version()}, {packages}\n{datetime.date.today().isoformat()}"


def processor() -> str:
    """The processor's name."""
    try:
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()


def memory_gb() -> float:
    """The machine's memory in GB."""
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 1e9
    except (ValueError, OSError, AttributeError):
        return float("nan")
