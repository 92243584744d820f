"""What a speed was measured on, and what it cost in energy."""

from __future__ import annotations

import importlib.metadata
import os
import platform
from pathlib import Path
from typing import Any

import jax

from gatjax import processors

RAPL = Path("/sys/class/powercap")
PACKAGES = ("jax", "mujoco", "mujoco-mjx", "evosax", "warp-lang")


def facts() -> dict[str, Any]:
    """Processor, devices and versions."""
    versions = {}
    for package in PACKAGES:
        try:
            versions[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            versions[package] = None
    return {
        "processor": _processor(),
        "cores": processors.usable(),
        "load": os.getloadavg()[0],
        "devices": [str(device.device_kind) for device in jax.devices()],
        "python": platform.python_version(),
        "versions": versions,
    }


def _processor() -> str:
    """Name of the processor, as far as the system tells."""
    try:
        lines = Path("/proc/cpuinfo").read_text(errors="replace").splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    names = [line.partition(":")[2] for line in lines if line.startswith("model name")]
    return names[0].strip() if names else platform.machine()


def device_memory() -> float | None:
    """Peak device memory of the process so far in GiB, if the device reports it."""
    stats = jax.local_devices()[0].memory_stats() or {}
    peak = stats.get("peak_bytes_in_use")
    return None if peak is None else round(peak / 2**30, 3)


def joules() -> float | None:
    """Energy since some time in the past, of GPUs and processors that can be read.

    NVML counts whole boards, RAPL processor packages (root, as a rule). None where
    neither can be read; RAPL's counters run over after some minutes.
    """
    found = [*_boards(), *_packages()]
    return sum(found) if found else None


def _boards() -> list[float]:
    """Joules of each NVIDIA board."""
    try:
        import pynvml  # pyright: ignore[reportMissingImports]

        pynvml.nvmlInit()
        boards = map(
            pynvml.nvmlDeviceGetHandleByIndex, range(pynvml.nvmlDeviceGetCount())
        )
        return [1e-3 * pynvml.nvmlDeviceGetTotalEnergyConsumption(b) for b in boards]
    except Exception:  # not installed, no driver, an old board: pynvml's own errors
        return []


def _packages() -> list[float]:
    """Joules of each processor package."""
    found = []
    for file in RAPL.glob("intel-rapl:?/energy_uj"):
        try:
            found.append(1e-6 * int(file.read_text()))
        except (OSError, ValueError):
            continue
    return found
