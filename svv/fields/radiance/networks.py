"""The networks of the stages: base radiance field, palette network (PCN) and unrestricted network (UCN).

Letters: S samples, P palette colours, G geometry features.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Hashable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import Any

import torch
from torch import Tensor, nn

from svv.core.colour import palette_shading
from svv.core.rays.extinction import MOST_LOG_EXTINCTION
from svv.core.strokes.strokes import Floats
from svv.fields.radiance.encodings import Encoding, HashGrid, SparseLattice
from svv.fields.radiance.occupancy import Occupancy
from svv.fields.radiance.phong import Beams, PhongLight
from svv.fields.radiance.rendering import Extinction
from svv.fields.radiance.widths import DIRECTION_WIDTH, FACING_WIDTH
from svv.fields.strokes.stored_strokes import Brushed
from svv.kernels.dispatch import kernels_for
from svv.kernels.types import Samples, Table

CONSTANT_HARMONIC, LINEAR_HARMONIC = 0.28209479177387814, 0.48860251190291987
"""Value of the first one, and factor of the next three, which are -y, z and -x of a direction."""


@dataclass(frozen=True)
class FieldSettings:
    """Architecture of a scene's networks; saved with the scene."""

    encoding: str = "lattice"
    """``lattice``: features on the vertices of occupied cells. ``hash``: the paper's hash grid."""
    resolutions: tuple[int, ...] = (16, 32, 64, 128)
    """Cells along the longest side of each lattice level, or the coarsest and finest of the hash grid."""
    features: int = 4
    """Features per level."""
    levels: int = 16
    """Levels of the hash grid."""
    log2_entries: int = 19
    """Rows of a hash level, as a power of two."""
    width: int = 64
    """Width of hidden layers."""
    shading: bool = True
    """Whether the lighting MLP also scales the diffuse colour, as a headlight does; the paper's MLP only adds grey."""
    lighting: str = "network"
    """Lighting of the palette's colours. ``network``: the lighting MLP. ``phong``: normals and a few numbers per
    region, which allow the light to be moved. ``none``: no lighting, for views drawn without shading."""
    headlight: str = "point"
    """Direction of a light at the camera, and in which networks take a point to be seen. ``point``: along each ray.
    ``axis``: along the camera's axis for all rays of a view, as in VTK's CPU ray caster."""
    finer: tuple[int, ...] = ()
    """Lattice levels beyond ``resolutions`` that the scene's original colours do not need but its paint may."""

    facing: bool = False
    """Whether features are a value and a normal, and the base network is given how far the normal turns to the ray."""

    def encode(self, occupancy: Occupancy) -> Encoding:
        """Return a new table for this scene."""
        return ENCODINGS[self.encoding](self, occupancy)

    def to_json(self) -> dict[str, object]:
        """Return plain values for the scene's header."""
        return asdict(self)


ENCODINGS: dict[str, Callable[[FieldSettings, Occupancy], Encoding]] = {
    "lattice": lambda s, o: SparseLattice(o.occupied, o.cells, s.resolutions, s.features),
    "hash": lambda s, o: HashGrid(s.levels, s.features, s.log2_entries, *s.resolutions),
}
"""Name -> maker of a new table for a scene. Without the lattice, an MLP gives the density, as in the paper."""


class Layers(nn.Sequential):
    """Linear layers with ReLU between them, run as one operation by the kernels of their device."""

    rough = True
    """Whether three digits are enough; kernels may then multiply in half precision."""

    @property
    def weights(self) -> list[Tensor]:
        """Weights of each layer, (to, from)."""
        return [layer.weight for layer in self if isinstance(layer, nn.Linear)]

    def forward(self, x: Tensor) -> Tensor:
        """Apply the layers. (S, I) -> (S, O)"""
        return kernels_for(x).network(x, self.weights, self.rough)


def mlp(inputs: int, width: int, hidden: int, outputs: int, rough: bool = True) -> Layers:
    """Build linear layers without biases and with ReLU between them, as in Instant-NGP.

    There are ``hidden`` layers of a ``width``; ``rough``: whether three digits are enough, as for colours.
    """
    layers: list[nn.Module] = []
    for _ in range(hidden):
        layers += [nn.Linear(inputs, width, bias=False), nn.ReLU(inplace=True)]
        inputs = width
    network = Layers(*layers, nn.Linear(inputs, outputs, bias=False))
    network.rough = rough
    return network


def encode_directions(directions: Tensor, ray: Tensor) -> Tensor:
    """Return spherical harmonics of each sample's ray: (R, 3) and (S,) -> (S, 16)."""
    return kernels_for(directions).directions_of_samples(directions, ray)


def learning(lattice: SparseLattice) -> Table:
    """Return a lattice's table and its gradient in the form that the kernels of training steps take."""
    return Table(lattice.layout, lattice.table.detach(), *lattice.buffers_for_gradient())


class BaseField(nn.Module):
    """Extinction and view-dependent colour (stage 1).

    With the lattice, the extinction is the exponential of a separate lattice with one feature per level. It is known
    before any network runs, so only visible samples are ever coloured. The colour features also serve as geometry
    features of the lighting MLP. With the hash grid, the field is the paper's: density MLP 32-64-16, colour MLP
    31-64-64-3.
    """

    def __init__(
        self, settings: FieldSettings, occupancy: Occupancy, density_resolutions: Sequence[int] | None = None
    ) -> None:
        """Lay out the field; the density has the features' levels unless ``density_resolutions`` are given."""
        super().__init__()
        self.encoding = settings.encode(occupancy)
        # Set by training if the extinction is a function of the volume's values; scenes keep it as a ValueFunction.
        self.extinction_table: Tensor | None = None
        self.density: SparseLattice | None = None
        self.density_mlp: Layers | None = None
        if not isinstance(self.encoding, SparseLattice):
            self.density_mlp = mlp(self.encoding.width, settings.width, 1, 16, rough=False)
            self.geometry_width = 15
        else:
            levels = density_resolutions or settings.resolutions
            self.density = SparseLattice(occupancy.occupied, occupancy.cells, levels, 1)
            self.geometry_width = self.encoding.width
        self.facing = settings.facing
        inputs = self.geometry_width + DIRECTION_WIDTH + FACING_WIDTH * self.facing
        self.colour_mlp = mlp(inputs, settings.width, 2, 3)

    @property
    def encodings(self) -> list[Encoding]:
        """Tables that :class:`svv.fields.radiance.encodings.LatticeAdam` optimises."""
        return [self.encoding] if self.density is None else [self.density, self.encoding]

    def geometry(self, samples: Samples) -> tuple[Tensor, Tensor]:
        """Return extinction (S,) and geometry features (S, G)."""
        features = self.encoding(samples.position)
        if self.density is not None:
            sigma = samples.sigma
            if torch.is_grad_enabled() and self.density.table.requires_grad:
                sigma = Extinction.apply(samples, self.density.table, self.density)
            return sigma, features
        assert self.density_mlp is not None
        h = self.density_mlp(features)
        return torch.exp(h[:, 0].clamp(max=MOST_LOG_EXTINCTION)), h[:, 1:]

    def extinction_at(self, position: Tensor) -> Tensor:
        """Return the extinction at box coordinates in occupied cells, without a graph. (S, 3) -> (S,)"""
        if self.density is not None:
            exponent = self.density.look_up(position).sum(dim=1)
        else:
            assert self.density_mlp is not None
            exponent = self.density_mlp(self.encoding.look_up(position))[:, 0].detach()
        return torch.exp(exponent.clamp(max=MOST_LOG_EXTINCTION))

    def extinction(self, samples: Samples) -> Tensor:
        """Return only the extinction, without a graph. (S,)"""
        return samples.sigma if self.density is not None else self.geometry(samples)[0]

    def forward(self, geometry: Tensor, directions: Tensor) -> Tensor:
        """Return RGB in (0, 1): (S, G) and encoded directions (S, 16) -> (S, 3)."""
        inputs = [geometry, directions]
        if self.facing:
            minus_y, z, minus_x = directions[:, 1:4].unbind(1)
            cosine = (geometry[:, 3] * z - geometry[:, 2] * minus_y - geometry[:, 1] * minus_x) / LINEAR_HARMONIC
            inputs += [cosine.abs()[:, None], cosine.square()[:, None]]
        return torch.sigmoid(self.colour_mlp(torch.cat(inputs, dim=1)))


@dataclass(frozen=True)
class PaletteColours:
    """Outputs of the PCN for samples."""

    specular: Tensor
    """Specular grey c_s >= 0. (S,)"""
    shade: Tensor
    """Shade m, the factor of the headlight on the diffuse colour, about 1. (S,)"""
    intensity: Tensor
    """Intensity I >= 0. (S,)"""
    weights: Tensor
    """Palette weights, > 0; they sum to 1. (S, P)"""
    offsets: Tensor
    """Offsets delta of the palette colours. (S, P, 3)"""

    @cached_property
    def region(self) -> Tensor:
        """Region of each sample: the index of its largest palette weight. (S,)"""
        return self.weights.argmax(dim=1)

    def diffuse(self, colours: Tensor) -> Tensor:
        """Mix offset colours (S, P, 3) into the diffuse one; see :mod:`svv.core.colour.palette_shading`. (S, 3)"""
        return palette_shading.diffuse(self.intensity, self.weights, colours)


class PaletteField(nn.Module):
    """Palette network: c = c_s + m I sum_i w_i (P_i + delta_i) (StyleRF-VolVis, eq. 4).

    The shade m(x, d) in (0, 2) is not in the paper: a headlight multiplies the material's colour by the cosine to its
    normal, which no added grey can express on coloured material. Without ``shading``, m is 1 and the network is the
    paper's; with the lighting ``none``, c_s is 0 as well; with ``phong``, both come from an explicit light.
    """

    def __init__(
        self,
        settings: FieldSettings,
        occupancy: Occupancy,
        geometry_width: int,
        colours: Tensor,
        normal_resolutions: Sequence[int] | None = None,
    ) -> None:
        """Lay out the field; an explicit light's normals have all levels unless ``normal_resolutions`` are given."""
        super().__init__()
        self.encoding = settings.encode(occupancy)
        self.colours = nn.Parameter(colours.clone())
        self.shading = settings.shading
        count, inputs = len(colours), geometry_width + DIRECTION_WIDTH
        self.lighting_mlp, self.phong = None, None
        if settings.lighting == "network":
            self.lighting_mlp = mlp(inputs, settings.width, 2, 2 if settings.shading else 1)
        elif settings.lighting == "phong":
            self.phong = PhongLight(occupancy, normal_resolutions or settings.resolutions + settings.finer, count)
        self.palette_mlp = mlp(self.encoding.width, settings.width, 1, 1 + 4 * count)

    def light_like(self, base: BaseField) -> None:
        """Start the lighting MLP's hidden layers from the base colour MLP's, without any light yet.

        Weights of a last layer for features of other sizes would saturate the shade, which then does not learn.
        """
        if self.lighting_mlp is None:
            return
        *hidden, last = self.lighting_mlp.weights
        with torch.no_grad():
            for mine, its in zip(hidden, base.colour_mlp.weights, strict=False):
                mine.copy_(its)
            last.zero_()

    def material(self, position: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Return view-independent intensity (S,), weights (S, P) and offsets (S, P, 3)."""
        return palette_shading.material(self.palette_mlp(self.encoding(position)))

    def lighting(self, geometry: Tensor, directions: Tensor) -> tuple[Tensor, Tensor]:
        """Return specular grey c_s >= 0 (S,) and shade m in (0, 2) (S,)."""
        if self.lighting_mlp is None:
            return geometry.new_zeros(len(geometry)), geometry.new_ones(len(geometry))
        return palette_shading.network_light(self.lighting_mlp(torch.cat([geometry, directions], dim=1)))

    def forward(
        self,
        position: Tensor,
        geometry: Tensor,
        directions: Tensor,
        beams: Beams | None = None,
        coefficients: Tensor | None = None,
    ) -> PaletteColours:
        """Return all parts of eq. 4 at box coordinates (S, 3).

        ``geometry`` features (S, G) and encoded ``directions`` (S, 16) are for the lighting MLP; ``beams`` (S) and
        ``coefficients`` of reflection, of palette colours (P, 4) or of each sample (S, P, 4), by default as learned,
        for an explicit light.
        """
        material = self.material(position)
        if self.phong is None:
            return PaletteColours(*self.lighting(geometry, directions), *material)
        assert beams is not None
        specular, shade = self.phong(position, material[1], beams, coefficients)
        return PaletteColours(specular, shade, *material)


class UnrestrictedField(nn.Module):
    """Unrestricted network: diffuse colour without a palette (StyleRF-VolVis, section UCN).

    If ``direct``, it is a lattice of one level whose features are the colours themselves. Paint has no pattern for a
    network to learn: the paper's network has to store the colour at each position separately anyway.
    """

    def __init__(
        self,
        settings: FieldSettings,
        occupancy: Occupancy,
        resolutions: Sequence[int] | None = None,
        direct: bool = False,
    ) -> None:
        """Lay out an untrained field; ``resolutions`` are those of its lattice, by default all of the settings."""
        super().__init__()
        self.resolutions = tuple(resolutions or settings.resolutions + settings.finer)
        self.colour_mlp: nn.Sequential | None = None
        self.brushed: Brushed | None = None
        """Strokes of which the lattice is made; None if it was painted otherwise."""
        self.edited: dict[Hashable, UnrestrictedField] = {}
        """The paint with edits of its strokes (:mod:`svv.fields.scene.stroke_edits`)."""
        self.painted_in: Callable[[], Any] | None = None
        """The scene that was painted, if this is its paint at another time step (:mod:`svv.fields.following`)."""
        self._unbaked: Callable[[Floats, float], Floats] | None = None
        self._occupancy = occupancy
        encoding: Encoding
        if direct:
            self.resolutions = self.resolutions[-1:]
            encoding = SparseLattice(occupancy.occupied, occupancy.cells, self.resolutions, 3)
        else:
            encoding = replace(settings, resolutions=self.resolutions).encode(occupancy)
            self.colour_mlp = mlp(encoding.width, settings.width, 2, 3)
        self._modules["encoding"] = encoding

    @property
    def direct(self) -> bool:
        """Whether the lattice holds the colours themselves."""
        return self.colour_mlp is None

    @property
    def unbaked(self) -> bool:
        """Whether its table has not been computed yet."""
        return self._unbaked is not None

    @property
    def encoding(self) -> Encoding:
        """Its table. Where that follows from strokes, it is computed when it is first read, in a second or two."""
        encoding = self._modules["encoding"]
        assert isinstance(encoding, Encoding)
        if self._unbaked is not None:
            assert isinstance(encoding, SparseLattice)
            place = encoding.places_of_level(0, self._occupancy.occupied, self._occupancy.cells)
            colours = torch.from_numpy(self._unbaked(place, 1.0 / encoding.resolutions[0]))
            with torch.no_grad():
                encoding.table.copy_(colours)
            self._unbaked = None
        return encoding

    def with_strokes(self, brushed: Brushed, baked: Callable[[Floats, float], Floats]) -> UnrestrictedField:
        """Return a field with the same layout and other strokes; ``baked`` is as for :meth:`bake_later`."""
        other, lattice = copy.copy(self), copy.copy(self._modules["encoding"])
        assert isinstance(lattice, SparseLattice)
        lattice._parameters = {"table": nn.Parameter(torch.zeros_like(lattice.table), requires_grad=False)}
        other._modules = {**self._modules, "encoding": lattice}
        other.edited = {}
        other.bake_later(brushed, baked)
        return other

    def bake_later(self, brushed: Brushed, baked: Callable[[Floats, float], Floats]) -> None:
        """Set the strokes of which the lattice is made, and compute its colours when they are first needed.

        ``baked`` returns the colours of vertices at box coordinates (V, 3) of a lattice with cells of a side. (V, 3)
        """
        self.brushed, self._unbaked = brushed, baked

    def forward(self, position: Tensor) -> Tensor:
        """Return diffuse RGB in [0, 1]. (S, 3) -> (S, 3)"""
        features = self.encoding(position)
        return features if self.colour_mlp is None else torch.sigmoid(self.colour_mlp(features))
