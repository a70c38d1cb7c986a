"""UDP as a byte link: a fixed far end to send to, or a port at which whoever speaks becomes the far end."""

from __future__ import annotations

import errno
import select
import socket

from drivers.errors import DeviceLostError, DriverError, PortBusyError, PortMissingError
from drivers.sources import Closing

_MOST_BYTES = 65536
_MOST_DATAGRAMS = 64  # a read takes so many at most, and the rest at the next call


class DatagramLink(Closing):
    """See drivers.sources.ByteLink; listen: wait at host:port, else send to host:port.

    A datagram that cannot leave at once is dropped, as the network would. Raises PortBusyError, PortMissingError, or
    DriverError where the socket cannot be had.
    """

    def __init__(self, host: str, port: int, *, listen: bool) -> None:
        self.name = f"udp {host}:{port}"
        self._closed = False
        self._far_end: tuple[str, int] | None = None
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        try:
            if listen:
                self._socket.bind((host, port))
            else:
                self._far_end = (socket.gethostbyname(host), port)
        except OSError as error:
            self._socket.close()
            raise _open_error(self.name, error) from error

    @property
    def port(self) -> int:
        """The own port, for whoever listens at port 0."""
        return int(self._socket.getsockname()[1])

    def read(self, timeout_s: float) -> bytes:
        """Return what has arrived; wait up to timeout_s for the first datagram."""
        self._check()
        if not select.select([self._socket], [], [], timeout_s)[0]:
            return b""
        received = []
        for _ in range(_MOST_DATAGRAMS):
            try:
                data, sender = self._socket.recvfrom(_MOST_BYTES)
            except BlockingIOError:
                break
            except ConnectionError:  # an earlier datagram found nobody: the far end may still come
                continue
            received.append(data)
            self._far_end = sender
        return b"".join(received)

    def write(self, data: bytes) -> None:
        """Send one datagram to the far end, if there is one yet."""
        self._check()
        if self._far_end is None:
            return
        try:
            self._socket.sendto(data, self._far_end)
        except (BlockingIOError, ConnectionError):
            return
        except OSError as error:
            raise DeviceLostError(f"{self.name}: sending failed ({error.strerror}): check the network") from error

    def set_baud(self, baud: int) -> None:
        """A network has no speed to set."""

    def set_dtr(self, asserted: bool) -> None:
        """A network has no such line."""

    def set_rts(self, asserted: bool) -> None:
        """Likewise."""

    def close(self) -> None:
        """Release the socket."""
        self._closed = True
        self._socket.close()

    def _check(self) -> None:
        if self._closed:
            raise DeviceLostError(f"{self.name}: closed: connect again")


def _open_error(name: str, error: OSError) -> DriverError:
    if error.errno == errno.EADDRINUSE:
        return PortBusyError(f"{name}: another program listens there: end it or take another port")
    if error.errno == errno.EADDRNOTAVAIL or isinstance(error, socket.gaierror):
        return PortMissingError(f"{name}: no such address ({error.strerror}): name one of this computer's, or 0.0.0.0")
    return DriverError(f"{name}: cannot be opened ({error.strerror})")
