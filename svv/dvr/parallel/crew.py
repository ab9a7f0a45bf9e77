"""The ranks of a parallel run as a crew that draws one volume together; only images travel, never the volume.

Each rank casts rays through its piece alone, with the samples of a single process: those at whole steps from the near
clipping plane, which all share; each lies in one rank's cells. The premultiplied images are composited front to back,
one band of rows per rank. The leader calls public methods, whose orders the others obey in :meth:`Crew.serve`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from vtkmodules.vtkCommonDataModel import vtkImageData
from vtkmodules.vtkRenderingCore import vtkRenderer

from svv.core.colour.shading import Shading
from svv.core.geometry.box import Box
from svv.core.geometry.cameras import Camera
from svv.core.rays.sort_last import front_to_back, over
from svv.core.volumes.classified import ClassifiedVolume, grid_shape
from svv.dvr.draw.casters import FULL, CpuMapper, Pixels, straight
from svv.dvr.draw.classify import classified_grid, extinction, frequencies, grid_over, resampled_part
from svv.dvr.draw.frame import MARGIN, Stage, place_part, visible_box, visible_cells
from svv.dvr.draw.tables import limits
from svv.dvr.functions.transfer_functions import TransferFunction
from svv.dvr.parallel.pieces import Indices, Piece, take_piece
from svv.dvr.parallel.ranks import Ranks
from svv.dvr.read.grids import index_to_world, to_array
from svv.errors import BadInput
from svv.io.files.keyed_results import digest

Array = NDArray[np.float64]
Result = TypeVar("Result")

CLIPPED = 0.01
"""Part of a voxel that VTK's CPU ray caster keeps from the planes at which it clips rays (ClipRayAgainstVolume)."""

FAR = 0.99995
"""Depth of a piece's farthest corner between the clipping planes, as VTK measures it, from 0 to 1."""

PARALLEL = 1e-6
"""Largest sine of the angle between parallel rays and a plane that they do not cross."""

END = "end"
ROUNDING = 1e-6
"""Part of a voxel or cell by which positions on a seam may be off."""


@dataclass(frozen=True, eq=False)
class PieceStage(Stage):
    """The stage of a whole volume with one rank's piece on it."""

    crew: Crew
    draws: bool
    """Whether a visible part of the volume is on this rank; if not, ``image`` has no meaning apart from its spacing."""
    drawn: Array
    """The box in which this rank draws: lower and upper corner on the stage. (2, 3)"""
    around: tuple[float, ...]
    """Bounds of the whole volume's visible part on the stage, as VTK has them."""

    def set_clipping_planes(self, renderer: vtkRenderer) -> None:
        """Place the near plane before the whole volume, as on the other ranks, and the far plane behind this piece.

        If the farthest corner lies between ``FAR`` and 1 in the clipping range, VTK's CPU ray caster casts all rays;
        otherwise it leaves out those through the outermost pixel of the box, which would show as seams.
        """
        renderer.ResetCameraClippingRange(self.around)
        view = renderer.GetActiveCamera()
        near = view.GetClippingRange()[0]
        corners = np.stack(np.meshgrid(*self.drawn.T, indexing="ij"), axis=-1).reshape(8, 3)
        depth = max(float(((corners - view.GetPosition()) @ view.GetDirectionOfProjection()).max()), near)
        if view.GetParallelProjection():
            far = near + (depth - near) / FAR
        else:
            far = FAR * near / (FAR - 1.0 + near / depth)
        view.SetClippingRange(near, far)


class PieceMapper(CpuMapper):
    """The CPU ray caster for one piece: its samples lie only in the rank's own cells."""

    def __init__(self, stage: PieceStage, shading: Shading, step: float) -> None:
        super().__init__(stage, shading, step)
        self._drawn, self._spacing = stage.drawn, np.array(stage.image.GetSpacing())
        self._mapper.SetCropping(1)
        self._mapper.SetCroppingRegionFlagsToSubVolume()

    def cast(self, camera: Camera) -> NDArray[np.uint16]:
        """Render the piece with premultiplied colours, from 0 to ``FULL``. (height, width, 4)"""
        # VTK ends rays that cross a cropping plane 0.01 voxels before it, so that samples near a seam would be lost.
        # It does not shorten rays parallel to the plane: at wider planes, both neighbours would draw those on a seam.
        _, direction, _ = self._stage.pose(camera)
        crossing = np.abs(direction) > PARALLEL if camera.is_orthographic else np.ones(3, bool)
        wider = np.outer((-1.0, 1.0), CLIPPED * self._spacing * crossing)
        self._mapper.SetCroppingRegionPlanes(*(self._drawn + wider).T.ravel())
        return super().cast(camera)

    @property
    def sees_nothing(self) -> bool:
        """Whether no cell of the piece is visible."""
        return len(self._blocks) == 0


class CrewMapper(CpuMapper):
    """The crew as one ray caster, for the leader."""

    def __init__(self, stage: Stage, shading: Shading, step: float) -> None:
        assert isinstance(stage, PieceStage)
        self._crew = stage.crew
        self._crew.open(shading, step)

    def render(self, camera: Camera) -> Pixels:
        """Render a view with straight alpha; its colour is 0 where alpha is 0. (height, width, 4) uint8"""
        return self._crew.render(camera)

    def set_step(self, step: float) -> None:
        """Set the sample distance, stage units."""
        self._crew.set_step(step)


class Crew:
    """One rank's share in drawing a volume, of which it has ``data`` (:func:`svv.dvr.parallel.pieces.take_piece`)."""

    def __init__(self, ranks: Ranks, data: vtkImageData | None, array: str | None, cells: bool = False) -> None:
        self.ranks, self._data, self._array, self._cells = ranks, data, array, cells
        self._piece: Piece | None = None
        self._stage: PieceStage | None = None
        self._mapper: PieceMapper | None = None
        self._boxes = np.zeros((0, 2, 3))

    # --- for the leader -----------------------------------------------------------------------------------------------

    @property
    def piece(self) -> Piece:
        """The leader's piece, which also describes the whole volume; raises BadInput as :func:`take_piece`."""
        self._need_piece()
        assert self._piece is not None
        return self._piece

    def _need_piece(self) -> None:
        if self._piece is None:
            self._do(self._take)

    def digest(self) -> str:
        """Return a hash of the volume's values and of their division."""
        self._need_piece()
        return self._do(self._digest)

    def put_on_stage(self, tf: TransferFunction) -> PieceStage:
        """Set the stage on all ranks, see :func:`svv.dvr.draw.frame.set_stage`; BadInput if nothing is visible."""
        self._need_piece()
        return self._do(self._put_on_stage, tf)

    def open(self, shading: Shading, step: float) -> None:
        """Open the ray casters; the step is in stage units."""
        self._do(self._open, shading, step)

    def set_step(self, step: float) -> None:
        """Set the sample distance, stage units."""
        self._do(self._set_step, step)

    def render(self, camera: Camera) -> Pixels:
        """Render a view of the whole volume with straight alpha. (height, width, 4)"""
        pixels = self._do(self._render, camera)
        assert pixels is not None  # None on the other ranks
        return pixels

    def classify(self, stage: Stage) -> ClassifiedVolume:
        """Classify the volume (:func:`svv.dvr.draw.classify.classified`): a coarse grid is sent, if any."""
        volume = self._do(self._classify)
        assert volume is not None  # None on the other ranks
        return volume

    def __enter__(self) -> Crew:
        return self

    def __exit__(self, *_: object) -> None:
        """Let the other ranks return from :meth:`serve`, even after an error."""
        self.ranks.order(END)

    def _do(self, work: Callable[..., Result], *arguments: object) -> Result:
        """Order all ranks to call this method with these arguments, and do so here."""
        self.ranks.order(work.__name__, *arguments)
        return work(*arguments)

    # --- for the others -----------------------------------------------------------------------------------------------

    def serve(self) -> None:
        """Do what the leader orders, until it has finished."""
        while True:
            name, arguments = self.ranks.next_order()
            if name == END:
                return
            try:
                getattr(self, name)(*arguments)
            except BadInput:
                continue  # all ranks raise it, and the leader reports it

    # --- on all ranks -------------------------------------------------------------------------------------------------

    def _take(self) -> None:
        self._piece = take_piece(self.ranks, self._data, self._array, self._cells)

    def _digest(self) -> str:
        piece = self.piece
        low, high = piece.own - piece.at
        inside = tuple(slice(a, b + 1) for a, b in zip(low[::-1], high[::-1]))
        own = np.ascontiguousarray(piece.values[inside])
        return digest(self.ranks.texts(digest(own, piece.own.tolist()) if piece.exists else ""))

    def _put_on_stage(self, tf: TransferFunction) -> PieceStage:
        piece, ranks = self.piece, self.ranks
        size = np.array(piece.whole.GetDimensions())

        def visible() -> Array:
            seen = visible_cells(piece.values, tf, piece.span) if piece.exists else np.zeros((1, 1, 1), bool)
            if not seen.any():
                return np.array([[np.inf] * 3, [-np.inf] * 3])
            return np.array(visible_box(seen, tf), np.float64) + piece.at

        boxes = ranks.everyones(ranks.together(visible))
        ends = boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)
        if not np.isfinite(ends).all():
            visible_box(np.zeros((1, 1, 1), bool), tf)  # raises BadInput
        first, last = (end.astype(np.int64) for end in ends)
        start, stop = np.maximum(first - MARGIN, 0), np.minimum(last + MARGIN, size - 1)
        own = np.stack([np.maximum(piece.own[0], start), np.minimum(piece.own[1], stop)])
        draws = piece.exists and bool((own[1] > own[0]).all())
        self._boxes = ranks.everyones(own.astype(np.float64) if draws else np.full((2, 3), np.nan))
        # A rank without a share still needs the stage itself; two transparent voxels along each axis are enough.
        values, at = (piece.values, piece.at) if draws else (np.zeros((2, 2, 2), piece.values.dtype), start)
        inside = tuple(slice(a, b + 1) for a, b in zip(np.maximum(start - at, 0)[::-1], (stop - at)[::-1]))
        part = values[inside] if draws else np.zeros(0)
        mine = [float(part.min()), float(part.max())] if draws else [np.inf, -np.inf]
        spans = ranks.everyones(np.array(mine))
        whole, kind = (float(spans[:, 0].min()), float(spans[:, 1].max())), values.dtype
        span = limits(tf, whole, kind)
        if span != whole:
            values = values.clip(*np.array(span).astype(kind))
        stage = ranks.together(lambda: place_part(values, at, (first, last), piece.whole, tf, span))
        around = _corners(stage, piece, np.stack([start, stop]))
        drawn = _corners(stage, piece, own)
        self._stage = PieceStage(**vars(stage), crew=self, draws=draws, drawn=drawn, around=tuple(around.T.ravel()))
        return self._stage

    def _open(self, shading: Shading, step: float) -> None:
        stage = self._stage
        assert stage is not None
        mapper = self.ranks.together(lambda: PieceMapper(stage, shading, step) if stage.draws else None)
        self._mapper = None if mapper is None or mapper.sees_nothing else mapper

    def _set_step(self, step: float) -> None:
        if self._mapper is not None:
            self._mapper.set_step(step)

    def _render(self, camera: Camera) -> Pixels | None:
        ranks, mapper = self.ranks, self._mapper
        width, height, rows = camera.width, camera.height, -(-camera.height // ranks.count)

        def bands() -> NDArray[np.uint16]:
            image = np.zeros((rows * ranks.count, width, 4), np.uint16)
            if mapper is not None:
                image[:height] = mapper.cast(camera)
            return image.reshape(ranks.count, rows, width, 4)

        order = self._order_for(camera)
        band = np.zeros((rows, width, 4), np.uint16)
        for number, part in enumerate(ranks.together(bands)):
            layers = ranks.gathered(part, number)
            if layers is not None:
                band = over(layers[order], FULL)
        image = ranks.gathered(straight(band), 0)
        return None if image is None else image.reshape(-1, width, 4)[:height]

    def _order_for(self, camera: Camera) -> list[int]:
        """Return the numbers of the ranks that draw, front to back as the camera sees their boxes."""
        to_index = np.linalg.inv(index_to_world(self.piece.whole))
        parallel = camera.is_orthographic
        eye = -camera.camera_to_world[:3, 2] if parallel else camera.position
        eye = to_index[:3, :3] @ eye + (0.0 if parallel else to_index[:3, 3])
        drawing = np.flatnonzero(np.isfinite(self._boxes).all(axis=(1, 2)))
        low, high = self._boxes[drawing].swapaxes(0, 1)
        return [int(drawing[i]) for i in front_to_back(low, high, eye, parallel)]

    def _classify(self) -> ClassifiedVolume | None:
        stage, ranks, own = self._stage, self.ranks, self._boxes[self.ranks.number]
        assert stage is not None
        box, cells = grid_over(stage)
        shape = grid_shape(box, cells) + 1
        image = to_array(stage.image)
        spans = ranks.everyones(np.array([image.min(), image.max()] if stage.draws else [np.inf, -np.inf], np.float64))
        function = extinction(stage, box, float(spans[:, 0].min()), float(spans[:, 1].max()))
        total = int((np.nanmax(self._boxes, axis=(0, 1)) - np.nanmin(self._boxes, axis=(0, 1)) + 1).prod())

        def count() -> Array:
            if not stage.draws:
                return np.zeros(len(function[0]))
            # The last voxels are counted by the neighbour that they also belong to.
            end = own[1] + (own[1] == np.nanmax(self._boxes[:, 1], axis=0))
            low, high = own[0].astype(int) - self.piece.at, end.astype(int) - self.piece.at
            inside = tuple(slice(a, b) for a, b in zip(low[::-1], high[::-1]))
            values = stage.staged(self.piece.values[inside])
            return frequencies(values, function[0], total) * values.size / total

        counts = ranks.everyones(ranks.together(count)).sum(axis=0)
        first, size = _vertices_in(stage, box, cells, shape) if stage.draws else (np.zeros(3, np.int64),) * 2

        def block() -> NDArray[np.float32]:
            return self._own_vertices(box, cells, first, size) if size.all() else np.zeros(0, np.float32)

        values = ranks.together(block)
        places = ranks.everyones(np.stack([first, size]).astype(np.float64)).astype(np.int64)
        if ranks.number:
            if values.size:
                ranks.send_to_leader(values)
            return None
        grid = np.full(shape[::-1], np.nan, np.float32)
        for number, (begin, extent) in enumerate(places):
            if extent.all():
                got = (ranks.receive(number) if number else values).reshape(extent[::-1])
                here = tuple(slice(a, a + n) for a, n in zip(begin[::-1], extent[::-1]))
                grid[here] = np.fmax(grid[here], got)
        return classified_grid(stage, box, cells, grid, function, counts)

    def _own_vertices(self, box: Box, cells: int, first: Indices, size: Indices) -> NDArray[np.float32]:
        """Return the values at vertices of a grid, NaN at those that belong to others. (Z, Y, X)"""
        stage, own = self._stage, self._boxes[self.ranks.number]
        assert stage is not None
        values = resampled_part(stage, box, cells, first, size)
        to_index = np.linalg.inv(index_to_world(self.piece.whole))
        steps = to_index[:3, :3] * (box.size / cells)
        corner = to_index[:3, :3] @ np.asarray(box.low) + to_index[:3, 3] + steps @ first
        x, y, z = np.arange(size[0]), np.arange(size[1])[:, None], np.arange(size[2])[:, None, None]
        ends = np.nanmin(self._boxes[:, 0], axis=0), np.nanmax(self._boxes[:, 1], axis=0)
        for axis in range(3):
            index = corner[axis] + steps[axis, 0] * x + steps[axis, 1] * y + steps[axis, 2] * z
            low = own[0, axis] - (ROUNDING if own[0, axis] > ends[0][axis] else 1.0)
            high = own[1, axis] + (ROUNDING if own[1, axis] < ends[1][axis] else 1.0)
            values[(index < low) | (index > high)] = np.nan
        return values


def _corners(stage: Stage, piece: Piece, indices: Indices) -> Array:
    """Return two corners of a box of voxels on the stage, the lower one first. (2, 3)"""
    matrix = index_to_world(piece.whole)
    world = indices @ matrix[:3, :3].T + matrix[:3, 3]
    return np.sort(stage.scale * (world - stage.centre) @ stage.rotation, axis=0)


def _vertices_in(stage: PieceStage, box: Box, cells: int, shape: Indices) -> tuple[Indices, Indices]:
    """Return the first vertex of a grid near the box in which a rank draws, and their numbers along x, y, z."""
    corners = np.stack(np.meshgrid(*stage.drawn.T, indexing="ij"), axis=-1).reshape(8, 3)
    world = corners / stage.scale @ stage.rotation.T + stage.centre
    places = (world - np.asarray(box.low)) * (cells / box.size)
    first = np.maximum(np.ceil(places.min(axis=0) - 1.0), 0).astype(np.int64)
    last = np.minimum(np.floor(places.max(axis=0) + 1.0), shape - 1).astype(np.int64)
    return first, np.maximum(last - first + 1, 0)
