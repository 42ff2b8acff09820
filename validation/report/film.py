"""A film of the MuJoCo car without a display: a camera behind the car, frames by EGL or OSMesa."""

import importlib
import math
import shutil
import subprocess
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np
from PIL import Image

from sidestep.plant_models.errors import InputError
from sidestep.plant_models.plant import Plant
from sidestep.validation.files import complete_path
from sidestep.validation.scenarios.scenario import Scenario

FRAMES_PER_SECOND = 20
SIZE = (540, 960)
"""Height and width, in [pixel]."""

_LIBRARIES = {"egl": "libegl1 libgl1-mesa-dri", "osmesa": "libosmesa6"}
_GIF_WIDTH = 640
_USUAL_LENGTH, _NEAREST = 4.5, 0.2  # car for which the camera's places are, in [m]; least share of its distance
NEEDED = "--plant mujoco or a MuJoCo model (.xml), without plant.steer_offset and plant.delay"
"""The plants that can be looked at."""


class Thinking(Protocol):
    """What the film needs of a controller."""

    @property
    def plan(self) -> Any:
        """The plan behind the last command."""
        ...


@runtime_checkable
class Scene(Protocol):
    """What camera and viewer need of a plant: MuJoCo's model and data."""

    model: Any
    data: Any

    @property
    def spot(self) -> tuple[float, float, float, float]:
        """Where the car is: x, y, z [m] and yaw [rad]."""
        ...


class Camera:
    """Pictures of a MuJoCo plant from behind the car."""

    def __init__(self, plant: Any, size: tuple[int, int] = SIZE):
        """Open an OpenGL context.

        Args:
            plant: A `Scene`.
            size: Height and width, in [pixel].

        Raises:
            InputError: Neither EGL nor OSMesa works here.
        """
        import mujoco

        height, width = size
        self._plant, self._context = plant, _context(width, height)
        plant.model.vis.global_.offwidth, plant.model.vis.global_.offheight = width, height
        self._scene = mujoco.MjvScene(plant.model, maxgeom=3000)
        self._render = mujoco.MjrContext(plant.model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._render)
        self._view, self._pixels = mujoco.MjvCamera(), np.empty((height, width, 3), np.uint8)

    def picture(self, scenario: Scenario, plan: Any) -> np.ndarray:
        """The scene now, with what the controller sees in it; shape (height, width, 3)."""
        import mujoco

        from sidestep.validation.report.scene import draw_plan

        model, data, view = self._plant.model, self._plant.data, self._view
        x, y, z, yaw = self._plant.spot
        mujoco.mj_camlight(model, data)
        size = scenario.vehicle.length / _USUAL_LENGTH
        view.lookat[:] = x + 6.0 * size * math.cos(yaw), y + 6.0 * size * math.sin(yaw), z
        view.azimuth, view.elevation, view.distance = math.degrees(yaw), -28.0, 19.0 * max(size, _NEAREST)
        every, option = mujoco.mjtCatBit.mjCAT_ALL.value, mujoco.MjvOption()
        mujoco.mjv_updateScene(model, data, option, mujoco.MjvPerturb(), view, every, self._scene)
        draw_plan(self._scene, scenario, plan, x, y)
        height, width, _ = self._pixels.shape
        viewport = mujoco.MjrRect(0, 0, width, height)
        mujoco.mjr_render(viewport, self._scene, self._render)
        mujoco.mjr_readPixels(self._pixels, None, viewport, self._render)
        return self._pixels[::-1].copy()

    def close(self) -> None:
        """Give the OpenGL context back."""
        self._render.free()
        self._context.free()


def _context(width: int, height: int) -> Any:
    for name in _LIBRARIES:
        try:
            context = importlib.import_module(f"mujoco.{name}").GLContext(width, height)
            context.make_current()
        except Exception:  # each library fails in its own way, down to AttributeError
            continue
        return context
    packages = ", or ".join(_LIBRARIES.values())
    raise InputError("--render", "neither EGL nor OSMesa works here", f"Debian packages {packages}")


@contextmanager
def film(plant: Plant, file: Path, scenario: Scenario, controller: Thinking) -> Iterator[Callable[[float], None]]:
    """Film a run; yields what is to be called with the simulated time, in [s]. The file is written at the end.

    Raises:
        InputError: Another plant than MuJoCo's, no OpenGL, or a file type that cannot be written.
    """
    if not isinstance(plant, Scene):
        raise InputError("--render", "the plant is not MuJoCo's", NEEDED)
    require_film(file)
    camera, frames = Camera(plant), []

    def shoot(simulated: float) -> None:
        if simulated * FRAMES_PER_SECOND >= len(frames) - 1e-6:
            frames.append(camera.picture(scenario, controller.plan))

    try:
        yield shoot
    finally:
        camera.close()
        write_film(file, frames)


def require_film(file: Path) -> None:
    """See that a film of this name can be written.

    Raises:
        InputError: Neither .gif nor .mp4, or .mp4 without ffmpeg.
    """
    if file.suffix not in (".gif", ".mp4"):
        raise InputError("--render", f"{str(file)!r}", "a name that ends in .gif or .mp4")
    if file.suffix == ".mp4" and not _ffmpeg():
        raise InputError(
            "--render", "no ffmpeg for .mp4", "a .gif, Debian package ffmpeg, or pip install imageio-ffmpeg"
        )


def _ffmpeg() -> str | None:
    try:
        return importlib.import_module("imageio_ffmpeg").get_ffmpeg_exe()
    except ImportError:
        return shutil.which("ffmpeg")


def write_film(file: Path, frames: Sequence[np.ndarray]) -> None:
    """Write frames at FRAMES_PER_SECOND, complete or not at all; a .gif is made smaller, as it does not compress."""
    if not frames:
        return
    with complete_path(file) as path:
        (_write_gif if file.suffix == ".gif" else _write_mp4)(path, frames)


def _write_gif(path: Path, frames: Sequence[np.ndarray]) -> None:
    height, width, _ = frames[0].shape
    small = (_GIF_WIDTH, round(_GIF_WIDTH * height / width))
    images = [Image.fromarray(frame).resize(small).quantize(128) for frame in frames]
    images[0].save(path, save_all=True, append_images=images[1:], duration=1000 // FRAMES_PER_SECOND, loop=0)


def _write_mp4(path: Path, frames: Sequence[np.ndarray]) -> None:
    height, width, _ = frames[0].shape
    command = [
        str(_ffmpeg()), "-y", "-loglevel", "error", "-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}",
        "-r", str(FRAMES_PER_SECOND), "-i", "-", "-pix_fmt", "yuv420p", str(path),
    ]  # fmt: skip
    subprocess.run(command, input=b"".join(frame.tobytes() for frame in frames), check=True)
