"""A Slurm of one node on this machine, of Debian's packages slurm-wlm and munge, for the time of one command.

    python tests/cluster/one_node.py snakemake --workflow-profile workflow/profiles/slurm quick

It listens on the loopback only. All its files are in a temporary folder; it ends the daemons that it has
started, and no others.
"""

from __future__ import annotations

import contextlib
import getpass
import os
import secrets
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from pathlib import Path
from string import Template

DAEMONS = ("munged", "slurmctld", "slurmd")
CONFIGURATION = Path(__file__).with_name("slurm.conf")
PATIENCE = 30
"""Seconds for the node to come up, and for its jobs to end."""


def missing() -> str:
    """What lacks for a Slurm, in a sentence; nothing if all is there."""
    lacking = [name for name in (*DAEMONS, "sbatch") if not shutil.which(name, path=_path())]
    if lacking:
        return f"there is no {', '.join(lacking)} here; Debian's packages slurm-wlm and munge have them"
    if not find_spec("snakemake_executor_plugin_slurm"):
        return "Snakemake's executor for Slurm is not installed; docs/cluster.md says how"
    return ""


@contextlib.contextmanager
def one_node() -> Iterator[dict[str, str]]:
    """The environment in which Slurm's commands, such as sbatch, talk to the node."""
    with contextlib.ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="slurm")))
        environment = _environment(folder, _write_configuration(folder))
        for name, *options in _commands(folder):
            _start_daemon(stack, [name, *options], environment, folder / f"{name}.log")
        _wait(lambda: _read_output(["sinfo", "-h", "-o", "%T"], environment) == "idle", folder)
        stack.callback(_cancel, environment, folder)
        yield environment


def _environment(folder: Path, configuration: Path) -> dict[str, str]:
    """That of this process, with the node's configuration.

    Snakemake's executor takes SLURM_CONF away from srun, which elsewhere is in /etc/slurm; here it is told.
    """
    (folder / "bin").mkdir()
    srun = folder / "bin/srun"
    real = shutil.which("srun")
    srun.write_text(f'#!/bin/sh\nSLURM_CONF={configuration} exec {real} "$@"\n', encoding="utf-8")
    srun.chmod(0o755)
    path = os.pathsep.join([str(folder / "bin"), _path()])
    return {**os.environ, "PATH": path, "SLURM_CONF": str(configuration)}


def _commands(folder: Path) -> Iterator[list[str]]:
    """The daemons with their options, each as soon as what it needs is there."""
    munge = ["key-file", "socket", "pid-file", "log-file", "seed-file"]
    yield ["munged", "--foreground", *(f"--{name}={folder}/munge.{name}" for name in munge)]
    _wait((folder / "munge.socket").exists, folder)
    yield ["slurmctld", "-D"]
    yield ["slurmd", "-D"]


def _write_configuration(folder: Path) -> Path:
    """slurm.conf, a key for munge, and the folders that slurm.conf names."""
    folder.chmod(0o755)  # munged wants its socket to be reached by all
    for name in ("state", "spool"):
        (folder / name).mkdir()
    key = folder / "munge.key-file"
    key.touch(0o600)
    key.write_bytes(secrets.token_bytes(1024))
    with socket.socket() as first, socket.socket() as second:
        for item in (first, second):
            item.bind(("127.0.0.1", 0))
        values = {
            "FOLDER": folder,
            "USER": getpass.getuser(),
            "HOST": socket.gethostname().partition(".")[0],
            "CONTROL_PORT": first.getsockname()[1],
            "NODE_PORT": second.getsockname()[1],
        }
    path = folder / "slurm.conf"
    path.write_text(Template(CONFIGURATION.read_text(encoding="utf-8")).substitute(values), encoding="utf-8")
    return path


def _start_daemon(
    stack: contextlib.ExitStack, command: list[str], environment: dict[str, str], log: Path
) -> None:
    """A daemon that ends with the stack."""
    output = stack.enter_context(log.open("w", encoding="utf-8"))
    daemon = subprocess.Popen(command, env=environment, stdout=output, stderr=output)
    stack.callback(daemon.wait)
    stack.callback(daemon.terminate)


def _cancel(environment: dict[str, str], folder: Path) -> None:
    """No job outlives the node."""
    subprocess.run(["scancel", "--user", getpass.getuser()], env=environment, check=False)
    _wait(lambda: not _read_output(["squeue", "-h"], environment), folder)


def _wait(until: Callable[[], bool], folder: Path) -> None:
    """Raises RuntimeError with the daemons' last words if it takes too long."""
    end = time.monotonic() + PATIENCE
    while not until():
        if time.monotonic() > end:
            texts = [f"{log.name}: {log.read_text()[-1000:]}" for log in sorted(folder.glob("*.log"))]
            raise RuntimeError("\n".join(["Slurm does not answer.", *texts]))
        time.sleep(0.2)


def _read_output(command: list[str], environment: dict[str, str]) -> str:
    """What a command prints; nothing if it fails."""
    return subprocess.run(
        command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    ).stdout.strip()


def _path() -> str:
    """Daemons are in folders that are not in everybody's PATH."""
    return os.pathsep.join([os.environ["PATH"], "/usr/sbin", "/sbin"])


def main(command: list[str]) -> int:
    """Runs a command beside the node; its exit code."""
    lacking = missing()
    if lacking:
        print(f"one_node: {lacking}", file=sys.stderr)
        return 2
    with one_node() as environment:
        return subprocess.run(command, env=environment).returncode


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
