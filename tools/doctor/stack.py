"""What this project needs of a machine beside time: a place for kernels, and for logs."""

from __future__ import annotations

from hoap3.protocol.config.settings import LogSettings
from hoap3.tools.doctor.system import Finding, System

ROOM = 2 * LogSettings().cap_mb * 1_000_000  # bytes: one run, both sides
LEAST_ROOM = 100_000_000
SLOW_DISK = 5_000_000  # bytes/s; HOAP-3 at 1 kHz writes some 0.3 MB/s, both sides together


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
