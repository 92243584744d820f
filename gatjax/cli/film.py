"""A walk as an mp4 video: MuJoCo's renderer and ffmpeg."""

from __future__ import annotations

import importlib
import tempfile
import warnings
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from gatjax.runs import write_whole

RATE = 25.0  # frames a second
SIZE = (1280, 720)


def encoder() -> Any:
    """Return what encodes videos.

    Raises:
        ImportError: one line: how to get it.
    """
    try:
        return importlib.import_module("imageio_ffmpeg")
    except ImportError as error:
        raise ImportError(
            "mp4 needs, in gatjax's folder: .venv/bin/pip install -c constraints.txt "
            "-e '.[video]'; or take .html"
        ) from error


def film(path: Path, model: mujoco.MjModel, qpos: np.ndarray, period: float) -> None:
    """Write states [T, nq], one each `period` s, as a video.

    Raises:
        ImportError, RuntimeError: one line; ffmpeg or OpenGL is missing.
    """
    ffmpeg = encoder()
    warnings.simplefilter("ignore")  # GLFW without a display, ffmpeg's fork
    try:
        renderer = mujoco.Renderer(model, height=SIZE[1], width=SIZE[0])
    except Exception as error:  # each GL library has errors of its own
        raise RuntimeError(
            f"no OpenGL to render with ({error}); set MUJOCO_GL to egl or osmesa, or "
            f"write .html"
        ) from error
    data, ticks = mujoco.MjData(model), np.arange(0, len(qpos), 1.0 / RATE / period)
    with renderer, tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "walk.mp4"
        writer = ffmpeg.write_frames(str(file), SIZE, fps=RATE)
        writer.send(None)
        for tick in ticks.astype(int):
            data.qpos[:] = qpos[tick]
            mujoco.mj_forward(model, data)
            renderer.update_scene(data, camera="track")
            writer.send(renderer.render().copy())
        writer.close()
        write_whole({path: file.read_bytes()})
