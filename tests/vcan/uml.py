#!/usr/bin/env python3
"""Run a command in a Linux kernel that has CAN, as an ordinary process of this one.

    python3 tests/vcan/uml.py [--time-limit S] [--out DIR] COMMAND [ARGUMENT ...]

boots Debian's user-mode-linux (packages user-mode-linux, busybox-static, iproute2; no root needed) on this
machine's own files, brings up `lo` and `vcan0`, runs COMMAND in the present folder with the present environment
and exits with its status; 124 when the time was up, 125 when no kernel came up.

Inside, every file of the machine is there but read-only, so nothing is left behind. Writable are the RAM disks
(HOME, TMPDIR, /dev/shm and NUMBA_CACHE_DIR, the last filled from the one outside) and DIR, under its own name.
One processor, root, real time; system calls are some ten times slower than outside.
"""

from __future__ import annotations

import argparse
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

TIME_IS_UP, NO_KERNEL = 124, 125
NEEDED = {"linux.uml": "user-mode-linux", "busybox": "busybox-static", "ip": "iproute2"}
MODULES = ("net/can/can", "net/can/can-raw", "net/can/can-bcm", "drivers/net/can/dev/can-dev",
           "drivers/net/can/vcan", "drivers/net/can/vxcan")  # fmt: skip

INIT = """#!/bin/sh
export PATH=/usr/sbin:/usr/bin:/sbin:/bin
mount -t proc proc /proc; mount -t sysfs sys /sys; mount -t tmpfs run /run
mkdir /dev/shm /run/host /run/home /run/tmp /run/numba; mount -t tmpfs shm /dev/shm
mount -t hostfs none /run/host -o {exchange}
{mount_out}
for module in {modules}; do
    busybox insmod "/usr/lib/uml/modules/$(uname -r)/kernel/$module.ko"
done
ip link set lo up && ip link add dev vcan0 type vcan && ip link set vcan0 up || busybox poweroff -f
(sleep {time_limit}; busybox poweroff -f) &
stty -F /dev/ttyS0 raw -echo
({command}; echo $? >/run/host/status) 2>&1 </dev/null | cat >/dev/ttyS0
sync
busybox poweroff -f
"""

COMMAND = """cd {folder} || exit
{environment}
export HOME=/run/home TMPDIR=/run/tmp NUMBA_CACHE_DIR=/run/numba PYTHONDONTWRITEBYTECODE=1 LANG=C.UTF-8
[ -z {numba_cache} ] || cp -r {numba_cache}/. /run/numba/ 2>/dev/null
{command}"""


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


def init_script(arguments: argparse.Namespace, exchange: Path) -> str:
    """The first process inside: mounts, modules, interfaces, then the command."""
    out = str(arguments.out.resolve()) if arguments.out else ""
    exports = "\n".join(
        f"export {name}={shlex.quote(value)}" for name, value in os.environ.items() if name.isidentifier()
    )
    command = COMMAND.format(
        folder=shlex.quote(os.getcwd()),
        environment=exports,
        numba_cache=shlex.quote(os.environ.get("NUMBA_CACHE_DIR", "")),
        command=shlex.join(arguments.command),
    )
    (exchange / "command").write_text(command)
    return INIT.format(
        exchange=exchange,
        mount_out=f"mount -t hostfs none {shlex.quote(out)} -o {shlex.quote(out)}" if out else "",
        modules=" ".join(MODULES),
        time_limit=arguments.time_limit,
        command=". /run/host/command",
    )


def boot(arguments: argparse.Namespace, exchange: Path) -> int:
    """Boot, pass the command's output on, and return its exit status."""
    init = exchange / "init"
    init.write_text(init_script(arguments, exchange))
    init.chmod(0o755)
    size = arguments.memory << 20
    kernel = ["linux.uml", f"mem={arguments.memory}M", "root=/dev/root", "rootfstype=hostfs", "rootflags=/", "ro",
              f"init={init}", f"uml_dir={exchange}", "con=null", "con0=null,fd:2", "ssl=null", "ssl0=null,fd:1",
              "quiet"]  # fmt: skip
    log = exchange / "kernel.log"
    time_is_up = threading.Event()
    with log.open("wb") as console:
        # The kernel makes its file descriptors non-blocking: it gets a pipe of its own, not our terminal.
        uml = subprocess.Popen(kernel, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=console,
                               env={"TMPDIR": memory_folder(size), "PATH": os.environ["PATH"], "HOME": str(exchange)},
                               start_new_session=True)  # fmt: skip

    def end() -> None:
        time_is_up.set()
        os.killpg(uml.pid, signal.SIGKILL)

    timer = threading.Timer(arguments.time_limit, end)
    timer.start()
    try:
        assert uml.stdout is not None
        while chunk := os.read(uml.stdout.fileno(), 65536):
            sys.stdout.buffer.write(chunk)
            sys.stdout.buffer.flush()
        uml.wait()
    finally:
        timer.cancel()
        if uml.poll() is None:
            os.killpg(uml.pid, signal.SIGKILL)
            uml.wait()
    status = exchange / "status"
    if time_is_up.is_set():
        print(f"uml: ended after the time limit of {arguments.time_limit} s", file=sys.stderr)
        return TIME_IS_UP
    if not status.exists():
        print(f"uml: the command was not run; the kernel said:\n{log.read_text(errors='replace')}", file=sys.stderr)
        return NO_KERNEL
    return int(status.read_text())


def main() -> int:
    parser = argparse.ArgumentParser(description="Run a command in a kernel that has vcan0.")
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
    missing = sorted(package for program, package in NEEDED.items() if shutil.which(program) is None)
    if missing:
        print(f"uml: missing here: apt-get install {' '.join(missing)}", file=sys.stderr)
        return NO_KERNEL
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, lambda received, _: sys.exit(128 + received))
    with tempfile.TemporaryDirectory(prefix="schwung-uml-", dir="/tmp") as exchange:
        return boot(arguments, Path(exchange))


if __name__ == "__main__":
    sys.exit(main())
