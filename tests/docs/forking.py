"""`kant-sql` as a fork of one process that has imported it: to import it takes most of a command.

    python forking.py SOCKET

is that process. It gets from each command its words, folder, environment and standard streams.
"""

from __future__ import annotations

import json
import os
import shlex
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

ASK = """\
import json, os, socket, sys
with socket.socket(socket.AF_UNIX) as server:
    server.connect({socket!r})
    said = [["kant-sql", *sys.argv[1:]], os.getcwd(), dict(os.environ)]
    socket.send_fds(server, [json.dumps(said).encode()], [0, 1, 2])
    server.shutdown(socket.SHUT_WR)
    sys.exit(int(server.recv(4) or 1))
"""
LONGEST = 1 << 20


@contextmanager
def commands(folder: Path) -> Iterator[Path]:
    """Start the process, and give a folder for `PATH` with a `kant-sql` that asks it."""
    path, ask, shim = folder / "socket", folder / "ask.py", folder / "kant-sql"
    process = subprocess.Popen(
        [sys.executable, __file__, str(path)], stdout=subprocess.PIPE, start_new_session=True
    )
    assert process.stdout is not None
    process.stdout.readline()
    ask.write_text(ASK.format(socket=str(path)))
    shim.write_text(f'#!/bin/sh\nexec {shlex.quote(sys.executable)} -IS {ask} "$@"\n')
    shim.chmod(0o755)
    try:
        yield folder
    finally:
        process.stdout.close()
        process.kill()
        process.wait()


def serve(path: str) -> None:
    """Fork for each command."""
    from kant_sql.cli.main import run

    signal.signal(signal.SIGCHLD, signal.SIG_IGN)
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(path)
        server.listen()
        print("ready", flush=True)
        while True:
            client, _ = server.accept()
            with client:
                if os.fork() == 0:
                    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
                    server.close()
                    client.sendall(b"%d" % answer(client, run))
                    os._exit(0)


def answer(client: socket.socket, run: object) -> int:
    """Run one command in this process, as if it had been started with it."""
    said, streams, _, _ = socket.recv_fds(client, LONGEST, 3)
    while more := client.recv(LONGEST):
        said += more
    argv, folder, environment = json.loads(said)
    for number, stream in enumerate(streams):
        os.dup2(stream, number)
        os.close(stream)
    os.environ.clear()
    os.environ.update(environment)
    os.chdir(folder)
    sys.argv = argv
    sys.stdin, sys.stdout, sys.stderr = (
        open(number, mode, encoding="utf-8", buffering=buffering)  # noqa: SIM115
        for number, mode, buffering in ((0, "r", -1), (1, "w", -1), (2, "w", 1))
    )
    try:
        assert callable(run)
        run()
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else int(end.code is not None)
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
    return 0


if __name__ == "__main__":
    serve(sys.argv[1])
