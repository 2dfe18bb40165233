"""Runs a planner, and ends it and all its processes: `guard.py MEMORY PROGRAM ARGUMENT...`.

The planner has its own session, no input, and MEMORY bytes of addresses (0 for no limit). If it
ends, or this process's standard input does, together with the calling process, all processes that
it started end, too. Then this process ends like the planner. It imports little, to start fast.
A caller that lives writes a byte to this input before it ends it. Without one, the caller was
killed, and the planner's working folder goes, too.
"""

import ctypes
import os
import resource
import select
import signal
import sys

SUBREAPER = 36  # prctl: on Linux, orphans below this process become its children.
MOST_FILE = 1 << 30
FOLDER = "kant-sql-plan-"


def main(memory: int, *command: str) -> None:
    """Run a command."""
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(SUBREAPER, 1, 0, 0, 0)
    died, wake = os.pipe()
    os.set_blocking(wake, False)
    signal.set_wakeup_fd(wake)
    signal.signal(signal.SIGCHLD, lambda number, frame: None)
    pid = os.fork()
    if pid == 0:
        become(memory, command)
    code, is_orphaned = None, False
    while code is None:
        ready, _, _ = select.select([0, died], [], [])
        if 0 in ready:
            is_orphaned = not os.read(0, 1)
            break
        os.read(died, 4096)
        code = reaped(pid)
    end_all(pid)
    if is_orphaned:
        remove_folder()
    if code is not None and code < 0:
        if -code != signal.SIGKILL:
            signal.signal(-code, signal.SIG_DFL)
        os.kill(os.getpid(), -code)
    os._exit(code or 0)


def become(memory: int, command: tuple[str, ...]) -> None:
    """Become the planner."""
    try:
        os.setsid()
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        signal.signal(signal.SIGPIPE, signal.SIG_DFL)
        if memory:
            resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
        resource.setrlimit(resource.RLIMIT_FSIZE, (MOST_FILE, MOST_FILE))
        os.execvp(command[0], command)
    except (OSError, ValueError) as error:
        os.write(2, f"{command[0]}: {error}\n".encode(errors="replace"))
    finally:
        os._exit(127)


def reaped(pid: int) -> "int | None":
    """Reap ended processes; return the planner's exit code if it has ended."""
    while True:
        try:
            found, status = os.waitpid(-1, os.WNOHANG)
        except ChildProcessError:
            return None
        if found == pid:
            return os.waitstatus_to_exitcode(status)
        if not found:
            return None


def end_all(pid: int) -> None:
    """Kill the planner's group and all processes below this one, until none is left."""
    while True:
        for kill, whom in [(os.killpg, pid), *((os.kill, one) for one in descendants())]:
            try:
                kill(whom, signal.SIGKILL)
            except (ProcessLookupError, PermissionError):
                continue
        try:
            os.waitpid(-1, 0)
        except ChildProcessError:
            return


def remove_folder() -> None:
    """Remove the working folder, if it is a caller's temporary one."""
    try:
        folder = os.getcwd()
    except OSError:  # The planner has removed it.
        return
    if os.path.basename(folder).startswith(FOLDER):
        import shutil  # Importing it takes long.

        shutil.rmtree(folder, ignore_errors=True)


def descendants() -> "list[int]":
    """Return the processes below this one."""
    below: dict[int, list[int]] = {}
    for pid, parent in processes():
        below.setdefault(parent, []).append(pid)
    found = [os.getpid()]
    for pid in found:
        found += below.get(pid, ())
    return found[1:]


def processes() -> "list[tuple[int, int]]":
    """Return all processes, each with its parent."""
    if not os.path.exists("/proc/self/stat"):
        import subprocess  # Importing it takes long.

        listed = subprocess.run(["ps", "-A", "-o", "pid=,ppid="], capture_output=True, check=False)
        return [(int(pid), int(up)) for pid, up in map(bytes.split, listed.stdout.splitlines())]
    found = []
    for name in os.listdir("/proc"):
        if name.isdecimal():
            try:
                with open(f"/proc/{name}/stat", "rb") as file:
                    found.append((int(name), int(file.read().rpartition(b")")[2].split()[1])))
            except OSError:
                continue
    return found


if __name__ == "__main__":
    main(int(sys.argv[1]), *sys.argv[2:])
