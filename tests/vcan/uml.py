#!/usr/bin/env python3
"""Run a command in a Linux kernel that has CAN, as an ordinary process of this one.

    python3 tests/vcan/uml.py [--time-limit S] [--out DIR] COMMAND [ARGUMENT ...]

boots Debian's user-mode-linux (packages user-mode-linux, busybox-static, iproute2; no root needed) on this
machine's own files, brings up `lo` and `vcan0`, runs COMMAND in this folder with this environment, and exits
with its status; 124 when the time was up, 125 when the command could not be run.

Inside, every file of the machine is there but read-only, so nothing is left behind. Writable are RAM disks
(HOME, with matplotlib's list of fonts, TMPDIR, /dev/shm, and NUMBA_CACHE_DIR, which starts with what is in it
outside) and DIR, under its own name. There is one processor, real time, and root; a system call costs 30 µs. pytest
is told to use one process and no cache of its own.
"""

from __future__ import annotations

import argparse
import contextlib
import mmap
import os
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
from pathlib import Path

TIME_IS_UP, NOT_RUN = 124, 125
PACKAGES = {"linux.uml": "user-mode-linux", "busybox": "busybox-static", "ip": "iproute2"}
MODULES = (
    *("net/can/can", "net/can/can-raw", "net/can/can-bcm"),
    *("drivers/net/can/dev/can-dev", "drivers/net/can/vcan", "drivers/net/can/vxcan"),
)

#: The first process inside. The kernel's own messages go to the console, the command's to the serial line.
INIT = """#!/bin/sh
export PATH=/usr/sbin:/usr/bin:/sbin:/bin
mount -t proc proc /proc; mount -t sysfs sys /sys; mount -t tmpfs run /run
mkdir /dev/shm /run/exchange /run/home /run/tmp /run/numba; mount -t tmpfs shm /dev/shm
mount -t hostfs exchange /run/exchange -o {exchange}
out={out}; [ -z "$out" ] || mount -t hostfs out "$out" -o "$out"
for module in {modules}; do
    busybox insmod "/usr/lib/uml/modules/$(uname -r)/kernel/$module.ko"
done
ip link set lo up && ip link add dev vcan0 type vcan && ip link set vcan0 up || busybox poweroff -f
(sleep {time_limit}; busybox poweroff -f) &
stty -F /dev/ttyS0 raw -echo
(. /run/exchange/command; echo $? >/run/exchange/status) 2>&1 </dev/null | cat >/dev/ttyS0
busybox poweroff -f
"""

COMMAND = """cd {folder} || exit
{environment}
[ -z "$NUMBA_CACHE_DIR" ] || cp -r "$NUMBA_CACHE_DIR/." /run/numba 2>/dev/null
fonts=${{XDG_CACHE_HOME:-$HOME/.cache}}/matplotlib
[ ! -d "$fonts" ] || {{ mkdir -p /run/home/.cache && cp -r "$fonts" /run/home/.cache; }}
unset XDG_CACHE_HOME
export HOME=/run/home TMPDIR=/run/tmp NUMBA_CACHE_DIR=/run/numba LANG=C.UTF-8
export PYTHONDONTWRITEBYTECODE=1 PYTEST_ADDOPTS="-n 0 -p no:cacheprovider"
{command}
"""


def memory_folder(size: int) -> str:
    """A folder for the kernel's memory file: it must have the room and allow pages to be executed."""
    for folder in (os.environ.get("TMPDIR", ""), "/dev/shm", "/tmp", "/var/tmp"):
        try:
            if shutil.disk_usage(folder).free < size:
                continue
            with tempfile.TemporaryFile(dir=folder) as probe:
                probe.truncate(mmap.PAGESIZE)
                mmap.mmap(probe.fileno(), mmap.PAGESIZE, prot=mmap.PROT_READ | mmap.PROT_EXEC).close()
        except OSError:
            continue
        return folder
    sys.exit(f"uml: no folder with {size >> 20} MiB to spare that allows execution; set TMPDIR to one")


def write_scripts(exchange: Path, command: list[str], out: Path | None, time_limit: int) -> None:
    """Write what runs inside, `init` and the `command` with our environment, into the exchange folder."""
    environment = "\n".join(
        f"export {name}={shlex.quote(value)}" for name, value in os.environ.items() if name.isidentifier()
    )
    (exchange / "command").write_text(
        COMMAND.format(folder=shlex.quote(os.getcwd()), environment=environment, command=shlex.join(command))
    )
    init = exchange / "init"
    init.write_text(
        INIT.format(
            exchange=exchange,
            out=shlex.quote(str(out.resolve()) if out else ""),
            modules=" ".join(MODULES),
            time_limit=time_limit,
        )
    )
    init.chmod(0o755)


def stay_on_one_processor() -> None:
    """The kernel runs its processes by tracing them, turn by turn: across processors each turn would wake another.

    That one it shall have to itself, where we may ask for it: tests in real time are about the kernel inside, not
    about what else the computer is doing.
    """
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    if hasattr(os, "sched_setscheduler"):
        with contextlib.suppress(PermissionError):
            os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(1))


def preloaded(exchange: Path) -> dict[str, str]:
    """What the kernel needs beside it where the processor has more registers than it knows; see registers.c."""
    processor = Path("/proc/cpuinfo")
    if not processor.exists() or " amx_tile" not in processor.read_text(encoding="utf-8"):
        return {}
    library, source = exchange / "registers.so", Path(__file__).with_name("registers.c")
    compiler = shutil.which("cc")
    if compiler is None:
        print(
            "uml: it will not start on this processor without a C compiler: apt-get install gcc",
            file=sys.stderr,
        )
        return {}
    subprocess.run([compiler, "-shared", "-fPIC", "-O1", "-o", library, source, "-ldl"], check=True)
    return {"LD_PRELOAD": str(library)}


def boot(exchange: Path, memory_mib: int, time_limit: int) -> int:
    """Boot, pass on what the command prints, and return its exit status."""
    kernel = [
        *("linux.uml", f"mem={memory_mib}M", f"uml_dir={exchange}", f"init={exchange}/init", "quiet"),
        *("root=/dev/root", "rootfstype=hostfs", "rootflags=/", "ro"),
        *("con=null", "con0=null,fd:2", "ssl=null", "ssl0=null,fd:1"),
    ]
    environment = os.environ | {"TMPDIR": memory_folder(memory_mib << 20)} | preloaded(exchange)
    log = exchange / "kernel.log"
    time_is_up = threading.Event()
    # A pipe and not our own terminal, since the kernel makes its descriptors non-blocking; a session of its
    # own, since it is a dozen processes that have to be killed as one.
    with log.open("wb") as console, subprocess.Popen(
        kernel, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=console, env=environment,
        start_new_session=True, bufsize=0,
    ) as uml:  # fmt: skip

        def kill() -> None:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(uml.pid, signal.SIGKILL)

        def end() -> None:
            time_is_up.set()
            kill()

        timer = threading.Timer(time_limit, end)
        timer.start()
        try:
            while chunk := uml.stdout.read(65536) if uml.stdout else b"":
                sys.stdout.buffer.write(chunk)
                sys.stdout.buffer.flush()
            uml.wait()
        finally:
            timer.cancel()
            if uml.poll() is None:
                kill()
    if time_is_up.is_set():
        print(f"uml: ended at the time limit of {time_limit} s", file=sys.stderr)
        return TIME_IS_UP
    status = exchange / "status"
    if not status.exists():
        print(f"uml: not run; the kernel said:\n{log.read_text(errors='replace')}", file=sys.stderr)
        return NOT_RUN
    return int(status.read_text())


def main() -> int:
    parser = argparse.ArgumentParser(description="Run a command in a Linux kernel that has vcan0.")
    parser.add_argument("--time-limit", type=int, default=300, help="seconds until everything is killed")
    parser.add_argument("--memory", type=int, default=2048, help="MiB")
    parser.add_argument("--out", type=Path, help="an existing folder that the command may write to")
    parser.add_argument("command", nargs=argparse.REMAINDER)
    arguments = parser.parse_args()
    if not arguments.command:
        parser.error("give the command to run")
    if arguments.out and not arguments.out.is_dir():
        parser.error(f"--out {arguments.out}: no such folder")
    os.environ["PATH"] += ":/usr/sbin:/sbin"
    missing = [package for program, package in PACKAGES.items() if shutil.which(program) is None]
    if missing:
        print(f"uml: missing here: apt-get install {' '.join(missing)}", file=sys.stderr)
        return NOT_RUN
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, lambda received, _: sys.exit(128 + received))
    stay_on_one_processor()
    with tempfile.TemporaryDirectory(prefix="schwung-uml-", dir="/tmp") as exchange:
        write_scripts(Path(exchange), arguments.command, arguments.out, arguments.time_limit)
        return boot(Path(exchange), arguments.memory, arguments.time_limit)


if __name__ == "__main__":
    sys.exit(main())
