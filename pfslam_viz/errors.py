"""The errors a user is meant to read: one line each, no traceback."""


class PfslamError(Exception):
    """A failure while running (exit status 1). The message is one line that says what happened."""

    exit_status = 1


class InputError(PfslamError):
    """Wrong use, or missing or unusable input (exit status 2). The message names the file and what to do."""

    exit_status = 2
