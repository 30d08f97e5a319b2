"""What this project needs of a machine beside time: versions, folders, a port, room for logs."""

from __future__ import annotations

import re

from hoap3.protocol.config.settings import LogSettings
from hoap3.robot_emulator.config import EmulatorConfig
from hoap3.tools.doctor.system import Finding, System

BLAS = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS")
ROOM = 2 * LogSettings().cap_mb * 1_000_000  # bytes: one run, both sides
LEAST_ROOM = 100_000_000
SLOW_DISK = 5_000_000  # bytes/s; HOAP-3 at 1 kHz writes some 0.3 MB/s, both sides together


def versions(system: System) -> Finding:
    """Is the stack the one that this was tested with?"""
    wrong, missing = [], []
    requirements = [text for text in system.requirements() if "extra ==" not in text]
    for text in requirements:
        name, bounds = _parts(text)
        version = system.installed(name)
        if version is None:
            missing.append(name)
        elif not all(_within(version, bound) for bound in bounds):
            wrong.append(f"{name} {version} (supported: {', '.join(bounds)})")
    if not requirements:
        remedy = "pip install . in the project's folder"
        return Finding("versions", "advice", "not installed as a package", remedy)
    if missing or wrong:
        found = "; ".join([*(f"{name} is missing" for name in missing), *wrong])
        remedy = "pip install -c constraints.txt -e ."
        return Finding("versions", "problem" if missing else "advice", found, remedy)
    return Finding("versions", "ok", f"{len(requirements)} in their supported ranges")


def blas_threads(system: System) -> Finding:
    """Do linear algebra libraries start threads beside a loop?"""
    set_to = {name: system.environment[name] for name in BLAS if system.environment.get(name)}
    found = ", ".join(f"{name}={value}" for name, value in set_to.items())
    if len(system.affinity()) == 1 or next(iter(set_to.values()), "") == "1":
        return Finding("BLAS threads", "ok", found or "one CPU, one thread")
    remedy = "OMP_NUM_THREADS=1 and none of the others; matters to controllers that use numpy"
    return Finding("BLAS threads", "advice", found or "as many as there are CPUs", remedy)


def kernel_cache(system: System) -> Finding:
    """Are compiled kernels kept for the next start?"""
    folder, kept = system.kernel_cache()
    if kept:
        return Finding("kernel cache", "ok", str(folder))
    found = f"only until the process ends: {folder}" if folder else "nowhere"
    remedy = "Set HOAP3_CACHE_DIR to a folder that is yours alone (chmod 700)"
    return Finding("kernel cache", "advice", found, remedy)


def log_disk(system: System) -> Finding:
    """Can logs be written, is there room, and does the disk keep up?"""
    folder = system.logs.absolute()
    while not folder.exists() and folder != folder.parent:
        folder = folder.parent
    try:
        free, speed = system.free(folder), system.write_speed(folder)
    except OSError as error:
        found = f"{folder}: {error.strerror or error}"
        remedy = "Set log.directory to a folder that can be written, or log.record=false"
        return Finding("disk for logs", "problem", found, remedy)
    rate = f"{speed / 1e6:.0f} MB/s synced" if speed else "no answer within a second"
    found = f"{folder}: {free / 1e9:.1f} GB free, {rate}"
    if free < ROOM:
        remedy = "Make room, or lower log.cap_mb"
        return Finding("disk for logs", "problem" if free < LEAST_ROOM else "advice", found, remedy)
    if speed < SLOW_DISK:
        remedy = "Set log.directory to a faster disk: loops never wait for it, but logs get gaps"
        return Finding("disk for logs", "advice", found, remedy)
    return Finding("disk for logs", "ok", found)


def port(system: System) -> Finding:
    """Is the robot's port free?"""
    endpoint = EmulatorConfig().link.listen[0]
    refusal = system.listen(int(endpoint.rpartition(":")[2]))
    if refusal is None:
        return Finding("port", "ok", f"{endpoint} is free")
    remedy = "`hoap3 list --live` shows a robot there, `ss -ltnp` anything; or set link.listen"
    return Finding("port", "advice", f"{endpoint}: {refusal}", remedy)


def _parts(requirement: str) -> tuple[str, list[str]]:
    """Name and bounds of a requirement such as "pin<5,>=4.0"."""
    text = requirement.partition(";")[0]
    name, bounds = re.split(r"(?=[\s\[<>=!~(])|$", text, maxsplit=1)
    return name, re.findall(r"[<>=!~]+\s*[\w.*+]+", bounds)


def _within(version: str, bound: str) -> bool:
    """Whether a version keeps a bound such as ">=1.10"; bounds of other kinds are kept."""
    ours, theirs = _numbers(version), _numbers(bound)
    if bound.startswith(">="):
        return ours >= theirs
    if bound.startswith("<") and not bound.startswith("<="):
        return ours < theirs
    return True


def _numbers(version: str) -> list[int]:
    """The release of a version, padded, so that 1.10 equals 1.10.0."""
    return [*map(int, re.findall(r"\d+", version)[:4]), 0, 0, 0][:4]
