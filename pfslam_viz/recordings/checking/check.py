"""The one check that every recording goes through, once, before it is replayed."""

from dataclasses import replace

from pfslam_viz.errors import InputError
from pfslam_viz.recordings.checking import beams, carried, clocks, contradiction, jumps, mounting, odometry, repeated
from pfslam_viz.recordings.checking.draft import Draft
from pfslam_viz.recordings.findings import Finding, of
from pfslam_viz.recordings.recording import Recording

STAGES = (
    clocks.check_unit,
    clocks.check_stray,
    beams.check_angles,
    repeated.check_repeated,
    beams.check_unit,
    beams.check_no_return,
    beams.check_far,
    beams.check_returns,
    odometry.check_odometry,
    jumps.check_jumps,
    carried.check_carried,
    mounting.check_mounting,
    contradiction.check_contradiction,
    beams.check_sweep,
    clocks.check_streams,
)
"""In this order: what one of them has mended, those after it can rely on."""

READER_NOTE = "reader_note"
"""What a finding is that was a note of the recording, made as it was read."""


def check(recording: Recording) -> Recording:
    """The recording with all that can be found wrong with it in ``findings``, and mended where that is safe.

    Its own notes are among the findings, and what was mended for certain among its notes. A recording that was checked
    before is returned as it is. Nothing is refused here: see :func:`refuse_wrong`.
    """
    if recording.checked:
        return recording
    draft = Draft(recording, list(recording.findings))
    for stage in STAGES:
        stage(draft)
        if draft.hopeless:
            break  # the rest would only follow from it
    known = {finding.message for finding in draft.findings}
    noted = [Finding("note", READER_NOTE, note) for note in recording.notes if note not in known]
    notes = [finding.message for finding in of(draft.findings, "note") if finding.message not in recording.notes]
    return replace(
        draft.recording,
        findings=(*draft.findings, *noted),
        notes=(*draft.recording.notes, *notes),
        checked=True,
    )


def refuse_wrong(recording: Recording, how: str = "--force") -> None:
    """Raise InputError for a checked recording that has a wrong finding: file, what, and what to do.

    ``how`` the user can have it replayed all the same.
    """
    if wrong := of(recording.findings, "wrong"):
        raise InputError(f"{recording.path or recording.name}: {wrong[0].line}; {how} replays it anyway")
