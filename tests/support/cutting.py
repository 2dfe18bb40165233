"""A proxy that cuts connections at random: before or after a request, or within its answer."""

from __future__ import annotations

import random
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress

PARTS = ("nothing", "before", "after", "answer")


class Proxy:
    """Forwards connections to a server, and cuts three of four.

    Attributes:
        target: the port of the server; it may change.
        port: its own port.
        cuts: the number of cut connections by place.
    """

    def __init__(self, target: int, seed: int) -> None:
        self.target = target
        self.cuts = dict.fromkeys(PARTS, 0)
        self._random = random.Random(seed)
        self._lock = threading.Lock()
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._listener.getsockname()[1]

    def serve(self) -> None:
        """Accept connections until it is closed."""
        while True:
            try:
                client, _ = self._listener.accept()
            except OSError:
                return
            threading.Thread(target=self._lead, args=(client,), daemon=True).start()

    def close(self) -> None:
        """Accept no more connections."""
        # Closing alone would not wake the accepting thread.
        with suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()

    def _lead(self, client: socket.socket) -> None:
        with self._lock:
            cut = self._random.choice(PARTS)
            part = self._random.random()
            self.cuts[cut] += 1
        with client, suppress(OSError):
            if cut == "before":
                return
            request = _read(client)
            with socket.create_connection(("127.0.0.1", self.target)) as server:
                server.sendall(request)
                if cut == "after":
                    return
                answer = b""
                while data := server.recv(1 << 16):
                    answer += data
            client.sendall(answer if cut == "nothing" else answer[: int(len(answer) * part)])


def _read(client: socket.socket) -> bytes:
    """Read a request with its body."""
    read = b""
    while b"\r\n\r\n" not in read:
        data = client.recv(1 << 16)
        if not data:
            raise ConnectionError
        read += data
    head, _, body = read.partition(b"\r\n\r\n")
    length = next(
        int(line.partition(b":")[2])
        for line in head.splitlines()
        if line.lower().startswith(b"content-length")
    )
    while len(body) < length:
        body += client.recv(1 << 16)
    return head + b"\r\n\r\n" + body


@contextmanager
def cutting(target: int, seed: int = 1) -> Iterator[Proxy]:
    """Run a proxy until the block ends."""
    proxy = Proxy(target, seed)
    thread = threading.Thread(target=proxy.serve)
    thread.start()
    try:
        yield proxy
    finally:
        proxy.close()
        thread.join()
