"""Standard output and error where they are closed, lose their reader, or take no more. Imports nothing heavy."""

import io
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager

from pfslam_viz.errors import PfslamError

_CLOSED: set[int] = set()


def open_all() -> None:
    """Have closed standard streams lead nowhere, and open ones take any text.

    A closed one's number would go to the next file that is opened, and what is printed would end up in there.
    """
    for descriptor, name, mode in ((0, "stdin", "r"), (1, "stdout", "w"), (2, "stderr", "w")):
        try:
            os.fstat(descriptor)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # gets the lowest number that is free, which is this one
            setattr(sys, name, open(descriptor, mode, encoding="utf-8", closefd=False))  # noqa: SIM115
            _CLOSED.add(descriptor)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def stdout_was_closed() -> bool:
    """Whether the program was started without standard output."""
    return 1 in _CLOSED


@contextmanager
def full_named() -> Iterator[None]:
    """Within the block, standard output that takes no more raises PfslamError; one that nobody reads is no error."""
    try:
        yield
    except BrokenPipeError:
        abandon_stdout()
    except OSError as error:
        abandon_stdout()
        raise PfslamError(f"standard output cannot be written: {error.strerror or error}") from None


def write_result(text: str) -> None:
    """Text to standard output as it stands. Errors as for :func:`full_named`."""
    with full_named():
        print(text, end="", flush=True)


def abandon_stdout() -> None:
    """Let nothing more come to standard output, whose reader is gone or whose disk is full, nor as Python ends."""
    nothing = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nothing, sys.stdout.fileno())
    os.close(nothing)
