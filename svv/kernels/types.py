"""Inputs and outputs of the kernels, and the functions that each set of kernels provides."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

from torch import Tensor, device
from torch.autograd.function import FunctionCtx


class Context(FunctionCtx):
    """What a differentiable function keeps from its forward pass for its backward pass."""

    saved_tensors: tuple[Tensor, ...]
    needs_input_grad: tuple[bool, ...]


@dataclass(frozen=True)
class Lattice:
    """Layout of a sparse lattice's features; L levels, on the device of its table."""

    shapes: Tensor
    """Number of vertices of each level along x, y, z, int64. (L, 3)"""
    scales: Tensor
    """Cells per box unit of each level, float32. (L,)"""
    bases: Tensor
    """First word of each level in ``index``, and the last row but one, which no look-up exceeds, int64. (L + 1,)"""
    index: Tensor
    """Which vertices are stored, and in which rows, int64; see :func:`svv.core.rays.encodings.stored_rows`."""


@dataclass(frozen=True)
class Room:
    """Room for the samples of rays on a GPU, where the CPU does not wait for their number."""

    samples: int
    """Number of samples for which there is room, > 0."""
    dropped: Tensor
    """Receives, added to what it holds, the number of rays for which there was none, int64. (1,)"""


@dataclass(frozen=True)
class Limits:
    """Limits that decide which samples a march keeps; see :class:`svv.fields.radiance.rendering.Marching`."""

    step: float
    """Sample spacing in box units."""
    least_weight: float
    """Smallest weight of a sample that is kept."""
    keep: float
    """Share of the samples of less weight that is kept all the same."""
    stop: float
    """Optical depth at which a ray ends."""
    fade: float
    """Smallest factor by which extinctions will be scaled later."""
    merge: bool
    """Whether samples of less weight are merged into the next one."""
    room: Room | None = None
    """Room for the samples; None for as much as they need. Only kernels of training steps with rows to
    ``SPARE`` take one."""


UNSURE = 255
"""Stands for occupied cells among distances to these; farther ones are then 254."""


@dataclass(frozen=True)
class Left:
    """What is left of rays for a march where a scene is cut open; see :mod:`svv.fields.radiance.cutting`."""

    begin: Tensor
    """Distances at which the pieces of rays begin, ascending, >= 0, in box units; whole rays if M = 0. (R, M)"""
    end: Tensor
    """Where they end; those with end <= begin are none. (R, M)"""
    distance: Tensor | None = None
    """As in :meth:`Kernels.march`, but with :data:`UNSURE` where optical depth neither dims nor ends a ray, because it
    may be of what is not shown. (8, X, Y, Z)"""


@dataclass(frozen=True)
class Samples:
    """The samples of rays that matter, in the order of their rays, front to back.

    ``position`` (S, 3): box coordinates; ``sigma`` (S,): extinction in 1 / box unit; ``skipped`` (S,): optical depth
    left out before each sample; ``ray`` (S,) int32: ray of each sample; ``start`` and ``count`` (R,) int64: first
    sample and number of samples of each ray; ``tail`` (R,): optical depth left out behind the last sample; ``step``:
    sample spacing in box units; ``total`` (1,) int64, if kernels read it on the device: number of samples. If there was
    more room (:class:`Room`), what follows them may be any numbers, and a ray without room has a count of -1.
    """

    position: Tensor
    sigma: Tensor
    skipped: Tensor
    ray: Tensor
    start: Tensor
    count: Tensor
    tail: Tensor
    step: float
    total: Tensor | None = None

    def to(self, where: device) -> Samples:
        """Return the samples on a device."""
        names = ("position", "sigma", "skipped", "ray", "start", "count", "tail")
        return replace(self, **{name: getattr(self, name).to(where) for name in names})

    def __len__(self) -> int:
        return len(self.sigma)

    @property
    def number(self) -> Tensor | int:
        """How many samples there are, as kernels of training steps take it: a number, or where on the GPU it lies."""
        return len(self) if self.total is None else self.total


@dataclass(frozen=True)
class RaySamples:
    """What rays see of the vertices of a grid: S samples in the order of their R rays, each standing for a vertex."""

    first: Tensor
    """First sample of each ray, and the number of samples, int32. (R + 1,)"""
    vertex: Tensor
    """Vertex of each sample, int32. (S,)"""
    weight: Tensor
    """Weight of each sample in its pixel. (S,)"""
    cosine: Tensor
    """Cosine between each sample's normal and the headlight. (S,)"""
    pixel: Tensor
    """Colours of pixels over black, RGB. (R, 3)"""
    along: Tensor
    """Directions of the pixels' colours; 0 for black. (R, 3)"""


@dataclass(frozen=True)
class VertexSamples:
    """The same samples in the order of the V vertices, and how vertices lie beside each other."""

    first: Tensor
    """First sample of each vertex, and the number of samples, int32. (V + 1,)"""
    ray: Tensor
    """Ray of each sample, int32. (S,)"""
    weight: Tensor
    """Weight of each sample in its pixel. (S,)"""
    lit: Tensor
    """Weight times cosine. (S,)"""
    neighbours: Tensor
    """Vertices beside each; itself where there is none, int32. (V, 6)"""
    root: Tensor
    """Square root of each vertex's light: neighbours must agree by the product of both. (V,)"""
    least: float
    """What is added to that product."""


class RegionKernels(Protocol):
    """What finds regions along rays (:mod:`svv.train.palette.along_rays`); P regions, Q >= P an even number.

    Plain torch (:mod:`svv.kernels.reference_regions`) defines the results.
    """

    def normal_equations(self, seen: RaySamples, region: Tensor, count: int) -> Tensor:
        """Return the normal equations of what ``count`` regions reflect of light from everywhere and of a headlight.

        The sums over rays of the products of what each sees of the 2 P unknowns, and of their products with its pixel,
        float64; the entries above the diagonal may be anything. ``region`` (V,) int64: of each vertex. (2 P, 2 P + 3)
        """

    def errors(self, seen: RaySamples, kept: float, light: Tensor, member: Tensor) -> Tensor:
        """Return what is shown less the pixels, of which the part ``kept`` is left along the pixels' colours. (R, 3)

        ``light`` (P, 6): what regions reflect of light from everywhere, and of a headlight; ``member`` (V, Q):
        memberships of vertices in regions.
        """

    def descend(
        self, near: VertexSamples, error: Tensor, light: Tensor, step: Tensor, pace: tuple[float, float], ahead: Tensor,
        member: Tensor, following: Tensor,
    ) -> None:  # fmt: skip
        """Take a step down the slope of the errors (R, 3), back to memberships >= 0 with sum 1, and look ahead.

        ``step`` (V,): length of each vertex's step; ``pace``: weight of the differences of neighbours, and how far to
        look ahead, in units of the step taken; ``ahead`` (V, Q): where the slope is taken; ``member`` (V, Q):
        memberships, before and after; ``following`` (V, Q): receives where to take the next slope.
        """

    def blurred(self, values: Tensor, deviation: float) -> Tensor:
        """Return a grid (X, Y, Z) blurred with a Gaussian, nothing beyond it; ``deviation``: in voxels.

        See :func:`svv.core.geometry.surfaces.blurred`.
        """

    def normals(self, field: Tensor, places: Tensor, deviations: Sequence[float]) -> Tensor:
        """Return the directions in which a field (X, Y, Z) changes most at some voxels (V, 3) int64. (V, 3)

        See :func:`svv.core.geometry.surfaces.surface_normals`; ``deviations``: inner and outer one.
        """


@dataclass(frozen=True)
class Target:
    """What the rays of a step should show."""

    along: Tensor
    """Unit vectors in which a light at the camera shines. (R, 3)"""
    shown: Tensor
    """Premultiplied RGBA in [0, 1]. (R, 4)"""
    weight: Tensor
    """Weight of each ray in the loss. (R,)"""


@dataclass(frozen=True)
class Table:
    """A lattice's features, which learn."""

    lattice: Lattice
    """Where they lie."""
    features: Tensor
    """The table. (V, F)"""
    gradient: Tensor
    """Receives the table's gradient, added to what it holds. (V, F)"""
    used: Tensor
    """Receives marks of the rows that have a gradient, uint8. (V,)"""


@dataclass(frozen=True)
class Owned:
    """The regions to which samples belong, and the penalty of palette weights in others.

    It is ``weight`` times -ln w of a sample's own region, averaged over the samples of each region.
    """

    owner: Tensor
    """Region of each sample, int64; any number behind the samples that there are. (S,)"""
    number: Tensor
    """Number of samples of each region, of all ranks, int64. (P,)"""
    weight: float
    """Weight of the penalty."""


class TrainingKernels(Protocol):
    """Whole training steps between the march and the optimisers, forward and backward, without autograd.

    Nothing waits for the GPU unless something is counted; samples may have room to spare (:class:`Samples`). Without
    these kernels, :mod:`svv.train` computes the same in plain torch. Letters as in :class:`Kernels`, and P palette
    colours.
    """

    SPARE: bool
    """Whether samples may have rows to spare, and numbers of a step may lie on the device, so that nothing waits."""

    def fits(self, weights: Sequence[Tensor]) -> bool:
        """Return whether a network, given by the weights of its layers (to, from), can be part of such a step."""

    def base(
        self, samples: Samples, target: Target, tables: tuple[Table, Table], weights: Sequence[Tensor], every: float,
        shift: Tensor, alpha: float, counted: bool,
    ) -> tuple[Tensor, list[Tensor], int]:  # fmt: skip
        """Sum the gradients of stage 1's loss (:mod:`svv.train.base.reconstruct`) into its tables.

        The loss is the mean squared error of colour plus ``alpha`` times that of alpha. ``tables``: log extinction and
        features; ``weights``: those of the colour network; ``every`` and ``shift``: as in
        :meth:`Kernels.representatives`.

        Returns the mean squared error of colour, a scalar, the gradients of the weights, and the number of colours for
        which there was room; if ``counted``, for which the CPU waits, it is the number that was computed.
        """

    def palette(
        self, samples: Samples, target: Target, geometry: tuple[Lattice, Tensor], material: Table,
        networks: tuple[Sequence[Tensor], Sequence[Tensor]], colours: Tensor, penalties: Sequence[float] | Tensor,
        owned: Owned | None,
    ) -> tuple[Tensor, list[Tensor]]:  # fmt: skip
        """Sum the gradient of stage 2's loss (:mod:`svv.train.palette.recolour`) into the table of the material.

        The loss is the mean squared error of colour (:mod:`svv.core.colour.palette_shading`) plus, composited like
        colours, three ``penalties`` times squared offsets, squared deviation of the shade from 1, and 1 minus the sum
        of squared palette weights; plus the penalty of what is ``owned``. ``geometry``: layout and frozen features;
        ``networks``: weights of the lighting and palette MLP; ``colours``: (P, 3).

        Returns the mean squared error of colour, a scalar, and the gradients of both networks' weights and of the
        colours.
        """

    def owned_by(self, samples: Samples, owner: Tensor, regions: int) -> Tensor:
        """Return how many samples each region owns, int64: (S,) int64 -> (regions,)."""

    def loss(
        self, out: Tensor, transmittance: Tensor, shown: Tensor, weight: Tensor, each: Tensor, alpha: bool
    ) -> tuple[Tensor, Tensor]:
        """Return a loss, and the mean squared error of colour without a graph, both scalars.

        ``out`` (R, C): colour, of which the squared difference from ``shown`` (R, 4) counts, and penalties, which count
        themselves; ``weight`` (R,): weight of each ray; ``each`` (C + 1,): that of each channel, and of the squared
        difference of 1 - ``transmittance`` (R,) from alpha, which counts if ``alpha``.
        """


HARMONICS = 16
"""Number of spherical harmonics of degree 4."""


@dataclass(frozen=True)
class Surface:
    """Appearance of samples before lighting.

    ``raw`` (S, 1 + 4 P): output of the palette MLP (:func:`svv.core.colour.palette_shading.material`); ``region`` (S,)
    int64: number of the largest palette weight, or of the part that it belongs to; ``colour`` (S, 3): diffuse colour,
    until :meth:`ImageKernels.light` or :meth:`ImageKernels.phong` lights it.
    """

    raw: Tensor
    region: Tensor
    colour: Tensor


@dataclass(frozen=True)
class PixelSource:
    """The pixels of views, from which training rays are drawn, on one device; K steps of contrast."""

    index: Tensor
    """Flat indices of the N pixels among all views, by steps of contrast, int32. (N,)"""
    levels: Tensor
    """Straight RGBA of all pixels of all views, uint8. (pixels, 4)"""
    first: Tensor
    """Where each step begins in ``index``, int64. (K + 1,)"""
    ends: Tensor
    """The same if each pixel counts as much as it is drawn, float64. (K + 1,)"""
    shares: Tensor
    """How much each step's pixels are drawn, relative to drawing evenly, float64. (K,)"""


class ImageKernels(Protocol):
    """An image of a palette scene from its samples, without gradients, each part in one pass over them.

    :mod:`svv.core.colour.palette_shading`, :mod:`svv.core.colour.light` and :mod:`svv.core.rays.compositing` define the
    results in plain torch. Letters as in :class:`Kernels`, and P palette colours.
    """

    def end(self, samples: Samples) -> None:
        """Make the depth behind each ray's last sample, ``tail``, a part of that sample's extinction, both in place.

        See :func:`svv.fields.radiance.rendering.ended`.
        """

    def looks(
        self, samples: Samples, along: Tensor, lattice: Lattice, tables: Tensor, lighting: Sequence[Tensor],
        palette: Sequence[Tensor],
    ) -> tuple[Tensor, Tensor]:  # fmt: skip
        """Return the outputs of the lighting MLP (S, 1 or 2) and palette MLP (S, 1 + 4 P), both to three digits.

        ``tables`` (V, 2 F): features of geometry and material, inputs (S, L F) of either; ``along`` (R, 3): unit
        vectors whose spherical harmonics of degree 4 are the last inputs of the lighting MLP; ``lighting`` and
        ``palette``: weights as in :meth:`Kernels.network`, of at least two layers.
        """

    def shift(self, raw: Tensor, column: int, colour: Tensor, change: Tensor, among: Tensor | None) -> None:
        """Change the offsets of a palette colour (3,) in ``raw`` (S, 1 + 4 P), from ``column`` on, in place.

        The colours become those of :func:`svv.core.colour.colour.with_change`, of all samples or ``among`` them (S,).
        """

    def material(self, raw: Tensor, colours: Tensor) -> Surface:
        """Apply equation 4 unlit (:mod:`svv.core.colour.palette_shading`) to (S, 1 + 4 P) and palette (P, 3)."""

    def overpaint(self, surface: Surface, paint: Tensor, share: Tensor, strokes: Tensor, sigma: Tensor) -> Tensor:
        """Blend paint (S, 3) into the surface's colour in place, and return the extinction that follows its strokes.

        ``share`` (regions,): weight of each region's paint in [0, 1]; ``strokes`` (regions, 4): how its extinction
        depends on paleness (:func:`svv.fields.scene.stroke_opacity.strokes_of`); ``sigma`` (S,): extinction before.
        """

    def light(self, surface: Surface, raw: Tensor, lights: Tensor) -> None:
        """Light the surface's colour in place with the output of the lighting MLP, ``raw`` (S, 1 or 2).

        ``lights`` (regions, 3): f, a and b of each region; see :func:`svv.core.colour.palette_shading.lit`.
        """

    def phong(
        self, surface: Surface, samples: Samples, beams: tuple[Tensor, Tensor, float], lattice: Lattice, table: Tensor,
        coefficients: Tensor, lights: Tensor,
    ) -> None:  # fmt: skip
        """Light the surface's colour in place with an explicit light (:func:`svv.core.colour.light.blinn_phong`).

        ``beams``: unit vectors of rays towards the viewer and the light, (R, 3) each, and the light's intensity;
        ``table`` (V, 3): normals in the form that :func:`svv.core.colour.light.normals_of` takes; ``coefficients``:
        those of the palette's colours, (P, 4) or for each sample (S, P, 4), mixed by the palette weights; ``lights``:
        as in :meth:`light`.
        """

    def composite(
        self, samples: Samples, sigma: Tensor, surface: Surface, opacity: Tensor, origins: Tensor, size: float,
        images: tuple[Tensor, Tensor, Tensor],
    ) -> None:  # fmt: skip
        """Composite rays into ``images``: straight RGBA (R, 4), depth (R,) and region (R,) int16.

        Whatever these held before, pixels whose alpha does not exceed :data:`svv.core.rays.compositing.LEAST_ALPHA`
        show nothing: zeros, NaN and -1. ``opacity`` (regions,) scales each region's extinction. A pixel's region is the
        one with most of its weight. Depth is measured from ``origins`` (R, 3) in world units; ``size`` is a box unit in
        these.
        """


class VertexKernels(Protocol):
    """An image whose colours are known at vertices of a grid and interpolated between them.

    The grid has cells of the side 1 / ``scale`` from the box's first corner on. V vertices around samples.
    """

    def touched(
        self, positions: Sequence[Tensor], shape: tuple[int, int, int], scale: float, most: float
    ) -> tuple[Tensor, Tensor] | None:
        """Return the vertices of the cells in which positions (S, 3) lie, of one or several sets.

        ``shape``: vertices along x, y and z; ``most``: vertices per position above which the result is None. Returns
        the places of the vertices in the grid, int32 (V,), in raster order, and their positions (V, 3).
        """

    def unlit(
        self, position: Tensor, lattice: Lattice, tables: Tensor, palette: Sequence[Tensor]
    ) -> tuple[Tensor, Tensor]:
        """Return what does not depend on the view: the lighting MLP's features (V, L F), and ``raw`` (V, 1 + 4 P).

        Arguments are those of :meth:`ImageKernels.looks`, for positions (V, 3).
        """

    def light(self, features: Tensor, rows: Tensor, along: Tensor, lighting: Sequence[Tensor]) -> Tensor:
        """Return the outputs of the lighting MLP (V, 1 or 2) for some ``rows`` (V,), int32, of features.

        What networks say by :meth:`unlit` and here is what :meth:`ImageKernels.looks` returns of many samples; each of
        the rows has a direction ``along`` (V, 3).
        """

    def interpolate(
        self, position: Tensor, places: Tensor, shape: tuple[int, int, int], scale: float, light: Tensor, raw: Tensor
    ) -> tuple[Tensor, Tensor]:
        """Return what networks say of vertices, ``light`` (V, L) and ``raw`` (V, C), at positions (S, 3) between them.

        ``places``: from :meth:`touched`. (S, L), (S, C)
        """

    def composite(
        self, pieces: Sequence[tuple[Samples, Tensor, tuple[Tensor, Tensor, Tensor]]], places: Tensor,
        shape: tuple[int, int, int], scale: float, colours: tuple[Tensor, Tensor | None, Tensor], regions: int,
        size: float,
    ) -> None:  # fmt: skip
        """Composite rays as :meth:`ImageKernels.composite`: ``pieces`` are samples, origins, and images to draw into.

        ``places``: from :meth:`touched`; ``colours``: colour (V, 3), factor on the extinction > 0 (V,), None if it is
        1 everywhere, and region (V,) of ``regions``. The factor is interpolated, the colour in proportion to it, and a
        sample's region is that of the nearest vertex.
        """


@dataclass(frozen=True)
class StrokeTables:
    """The strokes of a region on a device, as :class:`StrokeKernels` take them. K points, N strokes, B entries."""

    size: int
    """Bins along the box."""
    start: Tensor
    """First entry of each bin, and the number of entries, int64. (size^3 + 1,)"""
    entries: Tensor
    """Points whose paint may reach into each bin, the last first, int32. (B,)"""
    stroke: Tensor
    """Stroke of each point, int32. (K,)"""
    around: Tensor
    """See :func:`svv.kernels.numba.strokes.surroundings`. (K, 16)"""
    points: Tensor
    """Arc length, change of radius per length, and radius of each point. (K, 3)"""
    strokes: Tensor
    """Both colours, bristles and length of each stroke. (N, 8)"""
    seeds: Tensor
    """Where each stroke's irregularities begin in the noise, int32. (N,)"""
    noise: Tensor
    """:data:`svv.core.strokes.strokes.NOISE`."""
    look: Tensor
    """The brush, as :func:`svv.fields.strokes.stroke_tables.look_of` orders it. (22,)"""
    washes: bool
    """Whether any stroke is wet."""
    tooth: bool
    """Whether the tooth of the paper shows."""
    cells: int
    """Cells along the box in which the ground looks for points."""
    near: Tensor
    """Whether a cell or one of its neighbours has a point, uint8. ((cells + 2)^3,)"""
    first: Tensor
    """First point of each cell in ``inside``, and the number of points, int64. ((cells + 2)^3 + 1,)"""
    inside: Tensor
    """Points in the order of their cells, int32. (K,)"""
    tint: Tensor | None
    """Colour of the ground; None for the nearest stroke's times ``brightness``. (3,)"""
    brightness: float
    """Brightness of the ground relative to the nearest stroke."""
    bare: float
    """Coverage below which the ground shows."""


class StrokeKernels(Protocol):
    """Strokes in images without anything that comes back to the CPU; see :mod:`svv.fields.strokes.stroke_tables`."""

    def over(
        self, samples: Samples, region: Tensor, chosen: Tensor, apart: Tensor, tables: Sequence[StrokeTables],
        below: Tensor, flat: bool,
    ) -> Tensor:  # fmt: skip
        """Return the colours of samples with strokes over them; a sheet of samples has one colour. (S, 3)

        ``region`` (S,) int64: region of each sample; ``chosen`` (G,) int64, ``apart`` (G,) float64 and ``tables``: the
        regions with strokes, the gaps that separate their sheets, and their strokes; ``below``: colours where no stroke
        reaches, of the samples (S, 3), or, if ``flat``, of their regions.
        """


MOST_SEEN = 255
"""Views up to which those that contain a cell of the visual hull are counted."""


class TomographyKernels(Protocol):
    """What finds the visual hull and a first extinction from alpha; see :mod:`svv.train.base.tomography_kernels`."""

    def visual_hull(
        self, tables: Tensor, cameras: tuple[Tensor, Tensor, Tensor], cells: float, reach: float, shape: Sequence[int]
    ) -> Tensor:
        """Return how many views contain each cell that masks leave, 0 for others, uint8 (X, Y, Z) of this ``shape``.

        ``tables`` (N, H + 1, W + 1) int32: summed-area tables of the masks; ``cameras``: rotations (N, 3, 3), positions
        (N, 3) and lenses (N, 4), float64; ``cells`` a box unit, of this ``reach``: all as in
        :func:`svv.fields.radiance.hull_kernels.visual_hull`.
        """

    def optical_depths(
        self, rays: tuple[Tensor, Tensor], distance: Tensor, cells: int, extent: Sequence[float], step: float,
        shift: float, where: Lattice, table: Tensor, stop: float,
    ) -> Tensor:  # fmt: skip
        """Return the optical depth of rays, origins and directions (R, 3), up to ``stop``, or a step beyond it. (R,)

        ``distance``, ``cells``, ``extent``: as in :meth:`Kernels.march`; ``shift``: place of each sample within its
        ``step``; ``where`` and ``table``: log extinction on a lattice of one level.
        """

    def back_project(
        self, vertices: Tensor, scale: float, cameras: tuple[Tensor, Tensor, Tensor], images: Tensor
    ) -> Tensor:
        """Return the sum over views of what ``images`` (N, H, W, 2) hold where vertices (V, 3) are seen. (V, 2)

        ``vertices``: int32, ``scale`` of them a box unit; ``cameras``: as in :meth:`Kernels.pixel_rays`.
        """


class Kernels(Protocol):
    """The hot functions. All tensors of a call lie on one device; positions and directions are float32.

    Letters: S samples, R rays, L levels, F features per level, V rows of a table, C channels.
    """

    NAME: str
    """Name for reports: ``reference``, ``numba`` or ``triton``; code never branches on it."""
    RAYS: int
    """Number of rays of an image that are rendered at a time."""
    SAMPLES: int
    """Number of samples that a network with a graph processes at a time."""
    IMAGE: ImageKernels | None
    """Kernels for images of palette scenes on lattices; None if plain torch renders them, as in training."""
    VERTICES: VertexKernels | None
    """Kernels for images whose colours are known at vertices; None if every sample has its own, as on a GPU."""
    STROKES: StrokeKernels | None
    """Kernels for strokes in images; None if the CPU evaluates them (:mod:`svv.fields.strokes.stroke_paint`)."""
    TRAINING: TrainingKernels | None
    """Kernels that do several of a training step's operations in one; None if plain torch does them."""
    TOMOGRAPHY: TomographyKernels | None
    """Kernels for the first extinction; None if the CPU finds it (:mod:`svv.train.base.tomography`)."""
    REGIONS: RegionKernels
    """Kernels for regions that are found without the volume."""

    def lattice_encode(self, x: Tensor, lattice: Lattice, table: Tensor) -> Tensor:
        """Return the trilinear features of all levels, concatenated: (S, 3) and (V, F) -> (S, L * F)."""

    def lattice_backward(self, x: Tensor, g: Tensor, lattice: Lattice, gradient: Tensor, used: Tensor) -> None:
        """Add the table's gradient for ``g`` (S, L * F) to ``gradient`` (V, F); mark its rows in ``used`` (V,)."""

    def hash_encode(self, x: Tensor, resolutions: Tensor, offsets: Tensor, table: Tensor) -> Tensor:
        """Return the features of a hash grid: (S, 3) in [0, 1] and (V, F) -> (S, L * F)."""

    def hash_backward(
        self, x: Tensor, g: Tensor, resolutions: Tensor, offsets: Tensor, gradient: Tensor, used: Tensor
    ) -> None:
        """Add the table's gradient and mark its rows, as :meth:`lattice_backward` does."""

    def adam(
        self, table: Tensor, gradient: Tensor, used: Tensor, moments: Tensor, age: Tensor, rate: float | Tensor,
        constants: tuple[float, float, float], pull: float | Tensor, finer: int,
    ) -> None:  # fmt: skip
        """Take one Adam step on the rows marked in ``used``; clear their gradient and mark.

        ``moments`` (2, V, F): first and second; ``age`` (V,) int32: steps of each row; ``constants``: beta1, beta2 and
        epsilon. ``pull`` times the value is added to the gradient of the rows from ``finer`` on. A GPU reads tensors
        (1,).
        """

    def marked_rows(self, marks: Tensor) -> Tensor:
        """Return the indices of the rows that are marked, ascending: (V,) uint8, 0 or 1 -> (N,) int64."""

    def draw_pixels(
        self, source: PixelSource, seed: int | Tensor, first_ray: int, rays: int, total: int
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Draw the pixels of rays from number ``first_ray`` on, of ``total``, of the batch that ``seed`` numbers.

        Returns flat indices among all views (R,) int64, weights with which a sum over all rays is a mean over all
        pixels (R,), and premultiplied RGBA in [0, 1] (R, 4). A ray's pixel depends on its number and the seed alone,
        which may be an int32 tensor (1,), from which a GPU reads it.
        """

    def pixel_rays(
        self, pixels: Tensor, cameras: tuple[Tensor, Tensor, Tensor], width: int, height: int
    ) -> tuple[Tensor, Tensor]:
        """Return origins and unit directions (R, 3) of rays through flat pixel indices (R,) int64.

        ``cameras``: rotations (N, 3, 3), positions (N, 3) and lenses (N, 4); see :mod:`svv.kernels.numba.rays`.
        """

    def pixels_in_sight(
        self, camera: tuple[Tensor, Tensor, Tensor], width: int, height: int, distance: Tensor, cells: int,
        extent: Sequence[float],
    ) -> Tensor:  # fmt: skip
        """Return flat indices of pixels whose rays may meet an occupied cell, int64, in raster order if all may. (R,)

        Returns all pixels if marching them costs less than finding out. ``camera``: rotation (3, 3), position (3,) and
        lens (4,); ``distance``, ``cells`` and ``extent``: as in :meth:`march`.
        """

    def march(
        self, origins: Tensor, directions: Tensor, distance: Tensor, cells: int, extent: Sequence[float],
        lattice: Lattice, table: Tensor, ceiling: float, limits: Limits, seed: int | Tensor, room: int,
        first_ray: int = 0, left: Left | None = None,
    ) -> tuple[Samples, int]:  # fmt: skip
        """March rays through the occupied cells and keep the samples that matter (:mod:`svv.kernels.numba.marching`).

        ``distance`` (8, X, Y, Z) uint8: how far a ray may leap; ``extent``: sides of the box; ``table`` (V, 1): log
        extinction; ``room``: initial buffer size in samples per ray; returns the one that sufficed; ``first_ray``:
        number of the first ray in its batch, for its random numbers, whose ``seed`` may be an int32 tensor (1,);
        ``left``: the pieces of rays that are marched, without a seed; by default whole rays.
        """

    def representatives(self, samples: Samples, every: float, shift: Tensor) -> tuple[Tensor, Tensor]:
        """Return rows of representative samples (K,) and each sample's index in them (S,), both int64.

        ``shift`` (R,) in [0, 1) shifts each ray's cuts; see :func:`svv.core.rays.representatives.representatives`.
        """

    def composite(self, sigma: Tensor, values: Tensor, samples: Samples) -> tuple[Tensor, Tensor, Tensor]:
        """Return sums of weight times value (R, C), transmittance (R,) and weights (S,) for any ``sigma`` (S,)."""

    def composite_backward(
        self, sigma: Tensor, values: Tensor, weights: Tensor, samples: Samples, out: Tensor, transmittance: Tensor,
        g_out: Tensor, g_transmittance: Tensor,
    ) -> tuple[Tensor, Tensor]:  # fmt: skip
        """Return the gradients of :meth:`composite` with respect to ``sigma`` (S,) and ``values`` (S, C)."""

    def leaps(self, occupied: Tensor) -> Tensor:
        """Return how far a ray may leap: (X, Y, Z) uint8 -> (8, X, Y, Z) uint8 (:func:`svv.core.rays.cells.leaps`)."""

    def directions_of_samples(self, directions: Tensor, ray: Tensor) -> Tensor:
        """Return spherical harmonics of degree 4 of each sample's ray: (R, 3) and (S,) -> (S, 16); no graph."""

    def network(self, x: Tensor, weights: Sequence[Tensor], rough: bool) -> Tensor:
        """Run a small network without biases, ReLU between layers: (S, I) -> (S, O), differentiable in all inputs.

        ``weights``: those of each layer, (to, from). ``rough``: whether half precision is enough, as for colours. See
        :func:`svv.core.rays.networks.relu_layers`.
        """
