"""Standard output that may lose its reader: Rerun's own way of writing there waits for ever then, and so does its end.

Rerun writes into a pipe of ours instead, and a thread carries that over to the real standard output. Once nobody reads
there, or its disk is full, the thread goes on emptying the pipe into nothing, so that nobody has to wait.
"""

import errno
import os
import select
import sys
import threading
from collections.abc import Callable
from contextlib import suppress

STDOUT = 1
BLOCK = 1 << 16  # bytes carried at once: what a pipe holds
LOOK_SECONDS = 0.2  # how often it is looked whether somebody still reads
UNREAD = "nobody reads it any more"


class StdoutPipe:
    """File descriptor 1 is a pipe of ours from the construction to :meth:`close`.

    Attributes:
        carried: how many bytes have come to the real standard output.
        failure: why it takes no more; None as long as it does.
    """

    def __init__(self) -> None:
        sys.stdout.flush()
        self.carried = 0
        self.failure: str | None = None
        self._real = os.dup(STDOUT)
        self._reading, writing = os.pipe()
        os.dup2(writing, STDOUT)
        os.close(writing)
        self._thread = threading.Thread(target=self._carry, name="standard-output", daemon=True)
        self._thread.start()

    def close(self, seconds: float) -> bool:
        """Give standard output back, once everything was carried over; False where that took too long."""
        with suppress(OSError, ValueError):
            sys.stdout.flush()
        os.dup2(self._real, STDOUT)  # which closes the pipe's end that was there
        self._thread.join(seconds)
        return not self._thread.is_alive()

    def _carry(self) -> None:
        while True:
            if self.failure is None and not is_read(self._real):
                self.failure = UNREAD
            if not select.select([self._reading], [], [], LOOK_SECONDS)[0]:
                continue
            block = os.read(self._reading, BLOCK)
            if not block:
                break
            while block and self.failure is None:
                try:
                    written = os.write(self._real, block)
                except BlockingIOError:  # whoever started us wanted it so
                    select.select([], [self._real], [], LOOK_SECONDS)
                except OSError as error:
                    self.failure = UNREAD if error.errno == errno.EPIPE else error.strerror or str(error)
                else:
                    block = block[written:]
                    self.carried += written
        os.close(self._reading)
        os.close(self._real)


def fits() -> bool:
    """Whether this system lets us put a pipe before standard output, and a pipe or a file is what it is."""
    return hasattr(select, "poll") and not os.isatty(STDOUT)


def is_read(descriptor: int) -> bool:
    """Whether the other end of a pipe is still open; True for what is no pipe."""
    looked = select.poll()
    looked.register(descriptor, 0)
    gone = select.POLLERR | select.POLLHUP | select.POLLNVAL  # Linux says the first of a pipe, macOS the second
    return not any(event & gone for _, event in looked.poll(0))


def when_unread(action: Callable[[], None]) -> None:
    """Call ``action``, in a thread, once nobody reads standard output any more, whatever the program is busy with."""
    if not fits():
        return
    watched = os.dup(STDOUT)

    def watch() -> None:
        never = threading.Event()
        while is_read(watched):
            never.wait(LOOK_SECONDS)
        action()

    threading.Thread(target=watch, name="standard-output-watch", daemon=True).start()
