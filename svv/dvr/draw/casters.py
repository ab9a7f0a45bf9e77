"""VTK's two ray casters, each with a method ``render`` that takes a camera and returns straight-alpha pixels.

The CPU's computes a premultiplied image of 15 bits per channel, which is taken from memory: no OpenGL is needed, and
alpha is 128 times finer than a window's. The GPU's draws into an off-screen window, whose alpha is wrong in places, so
each view is drawn on black and on white: alpha = 1 - (white - black).
"""

from __future__ import annotations

import ctypes
import ctypes.util
import os
import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache

import numpy as np
import vtkmodules.vtkRenderingOpenGL2 as opengl  # also registers the implementation of renderers
import vtkmodules.vtkRenderingVolumeOpenGL2  # noqa: F401  # and that of the mappers
from numpy.typing import NDArray
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkMultiThreader, vtkUnsignedCharArray
from vtkmodules.vtkCommonDataModel import vtkImageData
from vtkmodules.vtkRenderingCore import vtkLight, vtkRenderer, vtkRenderWindow, vtkVolume, vtkVolumeProperty
from vtkmodules.vtkRenderingVolume import (
    vtkFixedPointRayCastImage,
    vtkFixedPointVolumeRayCastMapper,
    vtkGPUVolumeRayCastMapper,
    vtkVolumeMapper,
)

from svv.core.colour.shading import Shading
from svv.core.geometry.cameras import Camera
from svv.dvr.draw.frame import Stage, visible_cells
from svv.dvr.draw.tables import refine_tables
from svv.dvr.read.grids import to_array
from svv.dvr.read.vtk_readers import vtk_messages
from svv.errors import BadInput
from svv.measure import usable_cpus

Pixels = NDArray[np.uint8]

FULL = 32767
"""The value 1.0 in the CPU ray caster's 15-bit numbers."""

NEARLY_OPAQUE = FULL - 255
"""Alpha from which a pixel counts as opaque: the CPU ray caster ends rays at a transmittance below 255/32767."""

BLOCK = 4
"""Cells along each side of a block; rays that miss all visible blocks are skipped."""

TILE = 8
"""Pixels along each side of a tile, for which rays are skipped together."""

SOFTWARE_GL = ("llvmpipe", "softpipe", "swiftshader", "software rasterizer", "swrast")
"""Words in the names of OpenGL renderers that run on the CPU."""

NO_WINDOW = (
    "The GPU ray caster needs an off-screen OpenGL context, which cannot be created: install libegl1 libosmesa6 "
    "(Debian's names) or choose the CPU ray caster (--mapper cpu)."
)


class CpuMapper:
    """VTK's fixed-point ray caster for a volume on its stage, without a window; distances are in stage units."""

    name = "cpu"

    def __init__(self, stage: Stage, shading: Shading, step: float) -> None:
        self._stage = stage
        mapper = vtkFixedPointVolumeRayCastMapper()
        mapper.SetInputData(stage.reals)
        mapper.SetAutoAdjustSampleDistances(0)
        mapper.LockSampleDistanceToInputSpacingOff()
        mapper.IntermixIntersectingGeometryOff()
        mapper.SetNumberOfThreads(usable_cpus())
        self._mapper, self._volume = mapper, _volume(mapper, stage, shading)
        self.set_step(step)
        # This kind of window never creates an OpenGL context; the ray caster only asks for its size.
        self._window = opengl.vtkGenericOpenGLRenderWindow()
        self._renderer = _renderer(self._window, self._volume)
        self._blocks, self._radius = _visible_blocks(stage)

    def render(self, camera: Camera) -> Pixels:
        """Render a view with straight alpha; its colour is 0 where alpha is 0. (height, width, 4) uint8"""
        return straight(self.cast(camera))

    def cast(self, camera: Camera) -> NDArray[np.uint16]:
        """Render a view with premultiplied colours, from 0 to ``FULL``. (height, width, 4)"""
        self._window.SetSize(camera.width, camera.height)
        _place(self._renderer, self._stage, camera)
        pixels = np.zeros((camera.height, camera.width, 4), np.uint16)
        # The steps of vtkFixedPointVolumeRayCastMapper::Render, except the last one, which draws with OpenGL.
        self._mapper.PerImageInitialization(self._renderer, self._volume, 0, [0.0] * 3, [0.0] * 3, [0] * 6)
        self._mapper.PerVolumeInitialization(self._renderer, self._volume)
        self._mapper.PerSubVolumeInitialization(self._renderer, self._volume, 0)
        cast = self._mapper.GetRayCastImage()
        (width, height), (stride, rows) = cast.GetImageInUseSize(), cast.GetImageMemorySize()
        left, below = cast.GetImageOrigin()
        if width < 1 or height < 1:
            return pixels
        self._skip_empty_rays(cast, camera, (slice(below, below + height), slice(left, left + width)))
        with all_threads():
            self._mapper.RenderSubVolume()
        memory = _memory(cast.GetImage(), ctypes.c_uint16, rows * stride * 4).reshape(rows, stride, 4)
        top = camera.height - below - height
        pixels[top : top + height, left : left + width] = memory[height - 1 :: -1, :width]
        return pixels

    def _skip_empty_rays(self, cast: vtkFixedPointRayCastImage, camera: Camera, used: tuple[slice, slice]) -> None:
        """Skip rays that miss all visible cells, and end others behind the last in their tile, by a depth buffer."""
        from scipy.ndimage import maximum_filter

        position, direction, up = self._stage.pose(camera)
        offset = self._blocks - position
        depth = offset @ direction
        if depth.min() <= 2.0 * self._radius:  # the camera is among the blocks
            cast.SetUseZBuffer(0)
            return
        shape = (-(-camera.height // TILE), -(-camera.width // TILE))
        parallel = camera.is_orthographic
        pixels = camera.focal / self._stage.scale if parallel else camera.focal / depth  # in a stage unit
        centre = camera.principal_point
        across = offset @ np.cross(direction, up) * pixels + centre[0]
        upward = offset @ up * pixels + camera.height - centre[1]
        row, column = (upward // TILE).astype(int), (across // TILE).astype(int)
        inside = (row >= 0) & (row < shape[0]) & (column >= 0) & (column < shape[1])
        last = np.zeros(shape)
        np.maximum.at(last, (row[inside], column[inside]), depth[inside] + 2.0 * self._radius)
        most = camera.focal / self._stage.scale if parallel else camera.focal / (depth.min() - self._radius)
        reach = self._radius * most + 1.0  # radius of any block in pixels
        last = maximum_filter(last, 2 * int(np.ceil(reach / TILE)) + 1)
        near, far = self._renderer.GetActiveCamera().GetClippingRange()
        ends = np.zeros(shape, np.float32)  # 0: the ray ends where it starts
        hit = last > near
        ends[hit] = np.minimum((last[hit] - near if parallel else far * (1.0 - near / last[hit])) / (far - near), 1.0)
        depths = np.repeat(np.repeat(ends, TILE, axis=0), TILE, axis=1)[used]
        cast.SetUseZBuffer(1)
        cast.SetZBufferSize(depths.shape[1], depths.shape[0])
        cast.SetZBufferOrigin(used[1].start, used[0].start)
        cast.AllocateZBuffer()
        _memory(cast.GetZBuffer(), ctypes.c_float, depths.size)[:] = depths.ravel()

    def set_step(self, step: float) -> None:
        """Set the sample distance, stage units."""
        self._mapper.SetSampleDistance(step)
        self._mapper.SetInteractiveSampleDistance(step)

    def close(self) -> None:
        """Do nothing: there are no resources to release."""


class GpuMapper:
    """VTK's OpenGL ray caster for a volume on its stage, in an off-screen window (BadInput if there can be none)."""

    name = "gpu"

    def __init__(self, stage: Stage, shading: Shading, step: float) -> None:
        self._stage = stage
        mapper, shown = vtkGPUVolumeRayCastMapper(), stage.appearance
        image = vtkImageData()
        image.ShallowCopy(stage.reals)
        # VTK measures lengths in the data, so that a display's scale belongs to the volume.
        image.SetSpacing(*(np.array(image.GetSpacing()) / shown.stretch))
        image.SetOrigin(*(np.array(image.GetOrigin()) / shown.stretch))
        mapper.SetInputData(image)
        if shown.crop is not None:
            mapper.SetCropping(1)
            mapper.SetCroppingRegionFlagsToSubVolume()
            # VTK mistakes the first and the last voxel's centres for the edges of their texels.
            planes = (shown.crop + 0.5) * (1.0 - 1.0 / np.array(image.GetDimensions()))
            mapper.SetCroppingRegionPlanes(*(planes * image.GetSpacing() + image.GetOrigin()).T.ravel())
        mapper.SetAutoAdjustSampleDistances(0)
        mapper.SetLockSampleDistanceToInputSpacing(0)
        mapper.SetUseJittering(0)
        self._mapper = mapper
        self.set_step(step)
        self._window = off_screen_window()
        volume = _volume(mapper, stage, shading)
        refine_tables(volume.GetProperty(), *image.GetScalarRange())
        self._renderer = _renderer(self._window, volume)

    def render(self, camera: Camera) -> Pixels:
        """Render a view with straight alpha; its colour is 0 where alpha is 0. (height, width, 4) uint8"""
        self._window.SetSize(camera.width, camera.height)
        _place(self._renderer, self._stage, camera)
        black, white = (self._draw(level, camera) for level in (0.0, 1.0))
        return straight_alpha(black, white)[::-1]

    def _draw(self, level: float, camera: Camera) -> NDArray[np.float32]:
        self._renderer.SetBackground(level, level, level)
        with vtk_messages() as messages:
            self._window.Render()
            if "ERR" in messages():
                said = messages().strip().splitlines()[-1]
                raise BadInput(f"VTK's GPU ray caster failed ({said}); try --mapper cpu.")
        read = vtkUnsignedCharArray()
        self._window.GetPixelData(0, 0, camera.width - 1, camera.height - 1, 0, read, 0)
        return vtk_to_numpy(read).reshape(camera.height, camera.width, 3).astype(np.float32)

    def set_step(self, step: float) -> None:
        """Set the sample distance, stage units."""
        self._mapper.SetSampleDistance(step)

    def close(self) -> None:
        """Release the OpenGL context."""
        self._renderer.RemoveAllViewProps()
        self._window.Finalize()


def straight_alpha(black: NDArray[np.float32], white: NDArray[np.float32]) -> Pixels:
    """Return straight-alpha pixels (h, w, 4), 0 where alpha is, of levels on black and on white (h, w, 3)."""
    # Each channel is rounded separately; the mean of the three differences is the best estimate of alpha.
    alpha = np.clip(1.0 - (white - black).mean(axis=-1, keepdims=True) / 255.0, 0.0, 1.0)
    alpha = np.where((black == 0).all(-1, keepdims=True) & (alpha < 1 / 255), 0.0, alpha)
    colour = black / np.maximum(alpha, 1 / 255)
    levels = np.concatenate([colour, 255.0 * alpha], axis=-1)
    pixels: Pixels = np.clip(np.rint(levels), 0, 255).astype(np.uint8)
    pixels[pixels[..., 3] == 0] = 0
    return pixels


def choose_mapper(mapper: str) -> type[CpuMapper] | type[GpuMapper]:
    """Return the ray caster ``gpu`` or ``cpu``; ``auto`` is the GPU's if OpenGL runs on hardware; or raise BadInput."""
    if mapper not in ("auto", "gpu", "cpu"):
        raise BadInput(f"The mapper must be auto, gpu, cpu or bricks, not '{mapper}'.")
    return GpuMapper if mapper == "gpu" or (mapper == "auto" and hardware_opengl()) else CpuMapper


@cache
def hardware_opengl() -> bool:
    """Return whether a GPU draws off-screen windows here; loads OpenGL only if there may be one."""
    if sys.platform == "linux" and not any(map(os.path.exists, ("/dev/dri", "/dev/nvidiactl", "/dev/kfd"))):
        return False
    try:
        window = off_screen_window()
    except BadInput:
        return False
    found = re.search(r"OpenGL renderer string:\s*(.*)", window.ReportCapabilities() or "")
    window.Finalize()
    return found is not None and not any(word in found.group(1).lower() for word in SOFTWARE_GL)


def off_screen_window() -> vtkRenderWindow:
    """Return an off-screen window with a working OpenGL context, or raise BadInput, which says what to install."""
    window = None
    if sys.platform != "linux" or os.environ.get("DISPLAY"):
        window = vtkRenderWindow()
    elif hasattr(opengl, "vtkEGLRenderWindow") and ctypes.util.find_library("EGL"):
        window = opengl.vtkEGLRenderWindow()  # requested by name, because the default tries X first and reports errors
    elif hasattr(opengl, "vtkOSOpenGLRenderWindow") and ctypes.util.find_library("OSMesa"):
        window = opengl.vtkOSOpenGLRenderWindow()
    if window is None:
        raise BadInput(NO_WINDOW)
    window.SetOffScreenRendering(1)
    window.SetMultiSamples(0)
    window.SetSize(64, 64)
    with vtk_messages():
        window.Initialize()
        if not window.SupportsOpenGL():
            raise BadInput(NO_WINDOW)
    return window


@contextmanager
def all_threads() -> Iterator[None]:
    """Lift ParaView's limit of one thread in ``vtkMultiThreader``; on two cores, it doubles the ray caster's time."""
    limit = vtkMultiThreader.GetGlobalMaximumNumberOfThreads()
    vtkMultiThreader.SetGlobalMaximumNumberOfThreads(0)  # no limit
    try:
        yield
    finally:
        vtkMultiThreader.SetGlobalMaximumNumberOfThreads(limit)


def _memory(pointer: object, kind: type[ctypes.c_uint16 | ctypes.c_float], count: int) -> NDArray[np.number]:
    """Return an array of the memory at a pointer that VTK passes to Python as ``_<address>_p_void``."""
    address = re.match(r"_([0-9a-f]+)_p_", str(pointer))
    if address is None:
        raise RuntimeError(f"VTK returned a pointer in an unknown form: {pointer!r}")
    return np.ctypeslib.as_array((kind * count).from_address(int(address.group(1), 16)))


def _visible_blocks(stage: Stage) -> tuple[NDArray[np.float64], float]:
    """Return the centres (n, 3) of the blocks with visible cells, and the radius of a block, stage units."""
    seen = visible_cells(to_array(stage.image), stage.settled)
    padded = np.pad(seen, [(0, -size % BLOCK) for size in seen.shape])
    z, y, x = (size // BLOCK for size in padded.shape)
    blocks = np.argwhere(padded.reshape(z, BLOCK, y, BLOCK, x, BLOCK).any(axis=(1, 3, 5)))[:, ::-1]
    spacing = np.array(stage.image.GetSpacing())
    return (blocks + 0.5) * BLOCK * spacing + stage.image.GetOrigin(), float(0.5 * BLOCK * np.linalg.norm(spacing))


def straight(cast: NDArray[np.uint16]) -> Pixels:
    """Convert premultiplied 15-bit pixels to straight-alpha 8-bit pixels."""
    pixels: Pixels = np.zeros(cast.shape, np.uint8)
    shown = cast[..., 3] > 0
    numbers = cast[shown].astype(np.float32)  # (pixels, 4)
    alpha = numbers[:, 3]
    numbers[:, :3] *= (255.0 / alpha)[:, None]
    numbers[:, 3] = np.where(alpha >= NEARLY_OPAQUE, 255.0, alpha * (255.0 / FULL))
    levels = np.rint(np.minimum(numbers, 255.0)).astype(np.uint8)
    levels[levels[:, 3] == 0] = 0
    pixels[shown] = levels
    return pixels


def _volume(mapper: vtkVolumeMapper, stage: Stage, shading: Shading) -> vtkVolume:
    look = vtkVolumeProperty()
    colour, opacity = stage.settled.to_vtk()
    look.SetColor(colour)
    look.SetScalarOpacity(opacity)
    look.SetScalarOpacityUnitDistance(stage.unit_distance)
    if stage.appearance.nearest:
        look.SetInterpolationTypeToNearest()
    else:
        look.SetInterpolationTypeToLinear()
    look.SetShade(int(shading.on))
    look.SetAmbient(shading.ambient)
    look.SetDiffuse(shading.diffuse)
    look.SetSpecular(shading.specular)
    look.SetSpecularPower(shading.specular_power)
    volume = vtkVolume()
    volume.SetScale(*stage.appearance.stretch)
    volume.SetMapper(mapper)
    volume.SetProperty(look)
    return volume


def _renderer(window: vtkRenderWindow, volume: vtkVolume) -> vtkRenderer:
    renderer = vtkRenderer()
    renderer.AddVolume(volume)
    light = vtkLight()
    light.SetLightTypeToHeadlight()
    light.SetAmbientColor(1.0, 1.0, 1.0)  # black by default, which would remove the ambient term of the CPU ray caster
    renderer.AddLight(light)
    window.AddRenderer(renderer)
    return renderer


def _place(renderer: vtkRenderer, stage: Stage, camera: Camera) -> None:
    position, direction, up = stage.pose(camera)
    view = renderer.GetActiveCamera()
    view.SetPosition(*position)
    view.SetFocalPoint(*(position + direction))
    view.SetViewUp(*up)
    view.SetUseHorizontalViewAngle(1)
    view.SetParallelProjection(int(camera.is_orthographic))
    if camera.is_orthographic:
        view.SetParallelScale(0.5 * stage.scale * camera.height / camera.focal)
    else:
        view.SetViewAngle(float(np.degrees(camera.fov_x)))
    column, row = camera.principal_point
    view.SetWindowCenter(1.0 - 2.0 * column / camera.width, 2.0 * row / camera.height - 1.0)
    stage.set_clipping_planes(renderer)
    renderer.UpdateLightsGeometryToFollowCamera()
