"""Ctrl-C that lets a run end in good order."""

from pfslam_viz.errors import PfslamError
from pfslam_viz.interrupts import stop_on_interrupt as stop_on_interrupt


class Interrupted(PfslamError):
    """The user stopped the run (exit status 130). The message says what was kept."""

    exit_status = 130
