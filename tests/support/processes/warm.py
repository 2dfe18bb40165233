"""A Python that has already imported the library, which takes most of a short program's time.

    python warm.py SOCKET MODULE...

is a process that imports the modules and forks for each program; it ends with its input. The file
that replaces `python` passes on its arguments, folder, environment, standard streams and signals,
and ends like the fork.
"""

from __future__ import annotations

import atexit
import contextlib
import functools
import gc
import importlib
import io
import json
import os
import runpy
import selectors
import shlex
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
import traceback
from pathlib import Path
from typing import IO, Any, NoReturn

import kant_sql

# The modules that the library and `kant-sql` import, some of them lazily.
MODULES = (
    "alembic.command",
    "kant_sql.sql.dialects.postgresql",
    "kant_sql.sql.dialects.sqlite",
    "kant_sql.cli.main",
    "kant_sql.knowledge_base",
    "kant_sql.sql.catalog",
    "kant_sql.sql.predicate_views",
    "psycopg",
)
# The modules that a planner's process imports.
PLANNING = (
    "unified_planning.shortcuts",
    "up_fast_downward",
    "up_aries",
    "kant_sql.planning.worker",
)
ASK = """\
import json, os, signal, socket, sys
with socket.socket(socket.AF_UNIX) as server:
    server.connect({path!r})
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda number, frame: server.send(bytes([number])))
    said = json.dumps([sys.argv[1:], os.getcwd(), dict(os.environ)]).encode()
    socket.send_fds(server, [len(said).to_bytes(4)], [0, 1, 2])
    server.sendall(said)
    code = int(server.recv(9) or 1)
if code < 0:
    signal.signal(-code, signal.SIG_DFL)
    os.kill(os.getpid(), -code)
sys.exit(code)
"""


@functools.cache
def python(*modules: str) -> Path:
    """Start the process, and return a program that replaces `python`.

    It supports `-m MODULE` and `FILE`. It cannot show how Python starts, with other variables such
    as PYTHONUTF8 or without a standard stream, and what is imported when.

    Args:
        *modules: the modules to import.
    """
    # A short path, because a socket's path ends at about 100 characters.
    folder = Path(tempfile.mkdtemp(prefix="kantpy"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    path, ask, program = folder / "socket", folder / "ask.py", folder / "python"
    process = subprocess.Popen(
        [sys.executable, __file__, str(path), *modules],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        cwd=Path(__file__).parents[3],
        # A thread of a library that multiplies matrices would prevent the fork.
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
        start_new_session=True,
    )
    atexit.register(process.communicate)
    assert process.stdout is not None
    assert process.stdout.readline() == b"ready\n"
    ask.write_text(ASK.format(path=str(path)))
    # The path of Python may have a space, but not in the first line of a script.
    own = shlex.quote(sys.executable)
    # An isolated Python imports little.
    isolated = f'[ "$1" = -IS ] && exec {own} "$@"'
    program.write_text(f'#!/bin/sh\n{isolated}\nexec {own} -IS {ask} "$@"\n')
    program.chmod(0o755)
    return program


class Server:
    """Forks for each program, and reports to its caller how it ended."""

    def __init__(self, listener: socket.socket) -> None:
        self._listener = listener
        self._selector = selectors.DefaultSelector()
        self._selector.register(0, selectors.EVENT_READ)
        self._selector.register(listener, selectors.EVENT_READ)

    def serve(self) -> None:
        """Answer until the input ends."""
        while True:
            for key, _ in self._selector.select():
                if key.fileobj == 0:
                    os._exit(0)
                elif key.fileobj is self._listener:
                    self._start(self._listener.accept()[0])
                elif isinstance(key.fileobj, socket.socket):
                    self._pass_on(key.fileobj, key.data)
                elif isinstance(key.fileobj, int):
                    self._bury(key.fileobj, *key.data)

    def _start(self, client: socket.socket) -> None:
        size, streams, _, _ = socket.recv_fds(client, 4, 3)
        said = client.recv(int.from_bytes(size), socket.MSG_WAITALL)
        # Only the fork keeps the other end, so this one ends with the fork.
        alive, held = os.pipe()
        pid = os.fork()
        if pid == 0:
            run(streams, *json.loads(said))
        for descriptor in (held, *streams):
            os.close(descriptor)
        self._selector.register(client, selectors.EVENT_READ, pid)
        self._selector.register(alive, selectors.EVENT_READ, (client, pid))

    def _pass_on(self, client: socket.socket, pid: int) -> None:
        if client.fileno() < 0:
            return  # The program has ended at the same moment.
        if got := client.recv(1):
            os.kill(pid, got[0])
            return
        self._selector.unregister(client)
        with contextlib.suppress(ProcessLookupError):
            os.killpg(pid, signal.SIGKILL)

    def _bury(self, alive: int, client: socket.socket, pid: int) -> None:
        _, status = os.waitpid(pid, 0)
        self._selector.unregister(alive)
        os.close(alive)
        with contextlib.suppress(KeyError):
            self._selector.unregister(client)
        with contextlib.suppress(BrokenPipeError):
            client.send(str(os.waitstatus_to_exitcode(status)).encode())
        client.close()


def run(streams: list[int], words: list[str], folder: str, environment: dict[str, str]) -> NoReturn:
    """Become a program: with its process group, folder, environment and standard streams."""
    os.setpgid(0, 0)
    for number, stream in enumerate(streams):
        os.dup2(stream, number)
        os.close(stream)
    os.chdir(folder)
    os.environ.clear()
    os.environ.update(environment)
    time.tzset()
    sys.stdin = _stream(0, "r")
    sys.stdout = _stream(1, "w")
    sys.stderr = _stream(2, "w", buffering=1, errors="backslashreplace")
    code = 1
    try:
        code = exit_code(words)
        sys.stdout.flush()
    except BaseException:
        code = 1
        traceback.print_exc()
    finally:
        # The end of Python takes longer than most programs, because it frees all imports.
        os._exit(code)


def exit_code(words: list[str]) -> int:
    """Run a program, and return its exit code."""
    is_module = words[0] == "-m"
    sys.argv = words[is_module:]
    try:
        if is_module:
            sys.path.insert(0, os.getcwd())
            if not hasattr(sys.modules.get(words[1]), "__path__"):
                # `runpy` would warn if the module were already there.
                sys.modules.pop(words[1], None)
            runpy.run_module(words[1], run_name="__main__", alter_sys=True)
        else:
            sys.path.insert(0, str(Path(words[0]).parent))
            runpy.run_path(words[0], run_name="__main__")
    except SystemExit as end:
        if isinstance(end.code, str):
            sys.stderr.write(f"{end.code}\n")
            return 1
        return end.code or 0
    return 0


def _stream(number: int, mode: str, **options: Any) -> IO[str]:
    return open(number, mode, encoding="utf-8", closefd=False, **options)


def _use() -> None:
    """Use a store, so lazy imports are done and statements are compiled."""
    with tempfile.TemporaryDirectory() as folder:
        url = f"sqlite:///{folder}/store.db"
        with kant_sql.connect(url) as kb:
            kb.types.save(kant_sql.PddlTypeDto("warm"))
        if app := getattr(sys.modules.get("kant_sql.cli.main"), "app", None):
            for command in ("show", "log"):
                with contextlib.redirect_stdout(io.StringIO()), contextlib.suppress(SystemExit):
                    app([command, url])
    # Each program must find its own, by its environment.
    tempfile.tempdir = None


def main(path: str, *modules: str) -> None:
    """Import the modules, and serve."""
    sys.path[0] = os.getcwd()
    for module in modules:
        # Programs do not ask for a planner that is not installed.
        with contextlib.suppress(ModuleNotFoundError):
            importlib.import_module(module)
    _use()
    del sys.path[0]
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(path)
        listener.listen()
        # A fork copies no page with an object that is not collected.
        gc.freeze()
        print("ready", flush=True)
        Server(listener).serve()


if __name__ == "__main__":
    main(*sys.argv[1:])
