#!/usr/bin/env python3
"""Run a command where there is a real vcan0: Linux' own CAN stack, also on a kernel without CAN.

    vcanbox.py [--interfaces vcan0,vcan1] [--timeout 300] [--boot] -- COMMAND [ARGUMENT ...]

Where the running kernel has CAN and the interfaces are there (or may be made), the command simply runs. Elsewhere
(containers, most CI runners) it runs inside user-mode Linux: a Linux kernel that is an ordinary process, needs no
root and has the machine's own files as its root file system. Debian's packages user-mode-linux and can-utils (x86-64)
are fetched once with `apt-get download` and unpacked, not installed, into ~/.cache/vcanbox (~100 MB). Processors
with AMX need a C compiler, too, for a shim of a dozen lines.

The command keeps working directory, environment, output and exit status; it has no standard input and no network but
the CAN interfaces and the loopback; candump, cansend, ip and tc (with netem) are on its PATH and VCANBOX says
"native" or "booted". Booting takes about 3 s. Computation is as fast as outside; system calls, reading the clock among
them, take 10 to 30 us. There is one processor, for the guest and on the host.

Exit status: the command's; 124 if it took longer than --timeout; 125 if there is no way to a CAN bus here.
Needs nothing but Python's standard library.
"""

import argparse
import ctypes
import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

PACKAGES = ("user-mode-linux", "can-utils")
MODULES = (
    "net/can/can",
    "net/can/can-raw",
    "net/can/can-bcm",
    "drivers/net/can/dev/can-dev",
    "drivers/net/can/vcan",
    "net/sched/sch_netem",
    "net/sched/sch_prio",
    "net/sched/cls_basic",
    "net/sched/em_canid",
)
MOUNTS = (("proc", "/proc"), ("sysfs", "/sys"), ("tmpfs", "/run"), ("tmpfs", "/dev/shm"), ("devpts", "/dev/pts"))
OUTPUTS = ("out", "err")  # files that the command's output goes through
TIMED_OUT, NO_CAN = 124, 125
FINIT_MODULE = 313  # system call number on x86-64
POWER_OFF = 0x4321FEDC  # reboot(2)
XSTATE_SHIM = Path(__file__).with_name("xstate_shim.c")


class NoCanError(Exception):
    """There is no way to a CAN bus on this machine."""


# --- host


def main() -> int:
    """Parse the command line and run the command; returns the exit status."""
    options = parse_arguments()
    interfaces = options.interfaces.split(",")
    try:
        if not options.boot and native_can(interfaces):
            return run_command(options.command, {**os.environ, "VCANBOX": "native"}, timeout=options.timeout)
        return run_booted(options, interfaces)
    except NoCanError as error:
        print(f"vcanbox: {error}", file=sys.stderr)
        return NO_CAN
    except KeyboardInterrupt:
        return 128 + signal.SIGINT


def parse_arguments() -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(prog="vcanbox.py", description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--interfaces", default="vcan0", help="vcan interfaces to provide (default: vcan0)")
    parser.add_argument("--timeout", type=float, default=300.0, help="seconds the command may take (default: 300)")
    parser.add_argument("--memory", default="512M", help="ceiling of the booted kernel's memory (default: 512M)")
    parser.add_argument("--boot", action="store_true", help="boot, even if this kernel has CAN")
    parser.add_argument("command", nargs="+", help="what to run, after --")
    return parser.parse_args()


def native_can(interfaces: list[str]) -> bool:
    """Whether the running kernel has CAN and all interfaces, making them if that is allowed."""
    try:
        socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW).close()
        present = {name for _, name in socket.if_nameindex()}
        for name in interfaces:
            if name not in present:
                add_interface(name)
    except (OSError, subprocess.CalledProcessError):
        return False
    return True


def add_interface(name: str, environment: dict[str, str] | None = None) -> None:
    """Make a vcan interface and bring it up; mtu 72 lets CAN FD frames pass."""
    for arguments in (["add", name, "type", "vcan"], ["set", name, "mtu", "72", "up"]):
        subprocess.run(["ip", "link", *arguments], check=True, env=environment, stderr=subprocess.DEVNULL)


def run_command(command: list[str], environment: dict[str, str], **more: Any) -> int:
    """Run the command; its exit status as a shell gives it (128 + n for signal n, 127 if there is no such command)."""
    try:
        code = subprocess.run(command, env=environment, stdin=subprocess.DEVNULL, **more).returncode
    except FileNotFoundError:
        print(f"vcanbox: no such command: {command[0]}", file=sys.stderr)
        return 127
    except subprocess.TimeoutExpired:
        print(f"vcanbox: timed out after {more['timeout']:g} s", file=sys.stderr)
        return TIMED_OUT
    return code if code >= 0 else 128 - code


def provision() -> Path:
    """Folder with the unpacked packages, fetched on first use.

    Raises:
        NoCanError: They cannot be had.
    """
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache", "vcanbox")
    root = cache / "root"
    if root.exists():
        return root
    cache.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=cache) as folder:  # renamed when complete: the cache is never half full
        try:
            run_quietly(["apt-get", "download", *PACKAGES], folder)
            for package in Path(folder).glob("*.deb"):
                run_quietly(["dpkg", "-x", package.name, "root"], folder)
        except (OSError, subprocess.CalledProcessError) as error:
            detail = (getattr(error, "stderr", "") or str(error)).strip().splitlines()[-1]
            raise NoCanError(
                f"this kernel has no CAN, and Debian's {' and '.join(PACKAGES)} cannot be fetched ({detail}); "
                "try apt-get update, or a kernel with the vcan module"
            ) from error
        Path(folder, "root").replace(root)
    return root


def xstate_shim(root: Path) -> Path | None:
    """Library to preload into the kernel on processors with AMX, built on first use.

    Raises:
        NoCanError: There is no C compiler.
    """
    if " amx_tile " not in Path("/proc/cpuinfo").read_text().replace("\n", " "):
        return None
    shim = root / "xstate_shim.so"
    if not shim.exists():
        with tempfile.TemporaryDirectory(dir=root) as folder:
            compiler = os.environ.get("CC", "cc")
            try:
                run_quietly([compiler, "-shared", "-fPIC", "-O1", "-o", "shim.so", str(XSTATE_SHIM)], folder)
            except (OSError, subprocess.CalledProcessError) as error:
                raise NoCanError(
                    f"this kernel has no CAN, and booting one here needs a C compiler ({error})"
                ) from error
            Path(folder, "shim.so").replace(shim)
    return shim


def run_quietly(command: list[str], folder: str) -> None:
    """Run a command in `folder`, its output kept for the error."""
    subprocess.run(command, cwd=folder, check=True, capture_output=True, text=True)


def run_booted(options: argparse.Namespace, interfaces: list[str]) -> int:
    """Boot user-mode Linux, run the command in it, power off; the command's exit status, or `TIMED_OUT`.

    Raises:
        NoCanError: The kernel did not come up.
    """
    root = provision()
    with tempfile.TemporaryDirectory(prefix="vcanbox.", dir="/tmp") as name:
        folder = Path(name)
        prepare(folder, root, interfaces, options.command)
        kernel = boot(folder, root, options.memory)
        try:
            if not wait(kernel, folder, time.monotonic() + options.timeout):
                print(f"vcanbox: timed out after {options.timeout:g} s", file=sys.stderr)
                return TIMED_OUT
        finally:
            if kernel.poll() is None:
                os.killpg(kernel.pid, signal.SIGKILL)
                kernel.wait()
        try:
            return int((folder / "status").read_text())
        except (OSError, ValueError):
            console = (folder / "console").read_text(errors="replace").strip()
            raise NoCanError(f"user-mode Linux did not run the command; its console says:\n{console}") from None


def prepare(folder: Path, root: Path, interfaces: list[str], command: list[str]) -> None:
    """Lay out what the guest needs: this script and a description of the job."""
    path = f"{root}/usr/bin:{os.environ.get('PATH', os.defpath)}:/usr/sbin:/sbin"
    job = {
        "modules": str(root / "usr/lib/uml/modules"),
        "interfaces": interfaces,
        "command": command,
        "directory": str(Path.cwd()),
        "environment": {**os.environ, "PATH": path, "VCANBOX": "booted"},
    }
    (folder / "job.json").write_text(json.dumps(job))
    shutil.copy(__file__, folder / "init.py")  # the kernel's command line takes no spaces
    for name in OUTPUTS:
        (folder / name).touch()


def boot(folder: Path, root: Path, memory: str) -> "subprocess.Popen[bytes]":
    """Start the kernel with this script as its first process."""
    arguments = [
        f"mem={memory}", "rootfstype=hostfs", "rootflags=/", "rw", "quiet",
        "con=null", "con0=null,fd:1", f"uml_dir={folder}/", "umid=box",
        f"VCANBOX_JOB={folder}", f"init={Path(sys.executable).resolve()}", "--", "-I", "-S", f"{folder}/init.py",
    ]  # fmt: skip
    shim = xstate_shim(root)
    with (folder / "console").open("wb") as console:
        return subprocess.Popen(
            [root / "usr/bin/linux.uml", *arguments],
            env={**os.environ, "LD_PRELOAD": str(shim)} if shim else None,
            stdin=subprocess.DEVNULL,
            stdout=console,
            stderr=subprocess.STDOUT,
            start_new_session=True,
            preexec_fn=stay_on_one_processor,
        )


def stay_on_one_processor() -> None:
    """The guest has one, and each of its system calls goes back and forth between two processes of the host."""
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})


def wait(kernel: "subprocess.Popen[bytes]", folder: Path, deadline: float) -> bool:
    """Pass the command's output on until the kernel ends; False if the deadline came first."""
    with (folder / OUTPUTS[0]).open("rb") as out, (folder / OUTPUTS[1]).open("rb") as err:
        while True:
            ended = kernel.poll() is not None
            for source, sink in ((out, sys.stdout.buffer), (err, sys.stderr.buffer)):
                sink.write(source.read())
                sink.flush()
            if ended or time.monotonic() > deadline:
                return ended
            time.sleep(0.02)


# --- guest


def guest(folder: Path) -> None:
    """First process of the booted kernel: mount, load, bring up, run, power off."""
    libc = ctypes.CDLL(None, use_errno=True)
    try:
        job = json.loads((folder / "job.json").read_text())
        for kind, target in MOUNTS:
            os.makedirs(target, exist_ok=True)
            require(libc.mount(kind.encode(), target.encode(), kind.encode(), 0, None), f"mount {target}")
        for module in MODULES:
            load_module(libc, Path(job["modules"], os.uname().release, "kernel", f"{module}.ko"))
        subprocess.run(["ip", "link", "set", "lo", "up"], check=True, env=job["environment"])
        for name in job["interfaces"]:
            add_interface(name, job["environment"])
        for descriptor, name in enumerate(OUTPUTS, start=1):
            os.dup2(os.open(folder / name, os.O_WRONLY | os.O_APPEND), descriptor)
        status = run_command(job["command"], job["environment"], cwd=job["directory"])
        (folder / "status").write_text(str(status))
    except Exception as error:  # nobody above this process could show it
        print("vcanbox:", error, flush=True)
    finally:
        libc.sync()
        libc.reboot(POWER_OFF)


def require(result: int, what: str) -> None:
    """Raise what the C library reports."""
    if result:
        raise OSError(ctypes.get_errno(), f"{what}: {os.strerror(ctypes.get_errno())}")


def load_module(libc: ctypes.CDLL, file: Path) -> None:
    """Insert a kernel module; vcan with echo=1, so that its frames pass the queueing discipline (tc netem)."""
    parameters = b"echo=1" if file.stem == "vcan" else b""
    descriptor = os.open(file, os.O_RDONLY)
    require(libc.syscall(FINIT_MODULE, descriptor, parameters, 0), f"load {file.stem}")
    os.close(descriptor)


if __name__ == "__main__":
    if os.getpid() == 1 and "VCANBOX_JOB" in os.environ:
        guest(Path(os.environ["VCANBOX_JOB"]))
    sys.exit(main())
