"""One training run: from views to a scene, stage by stage, within an optional time limit."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import torch

from svv.core.colour.palette import Palette
from svv.core.geometry.cameras import CameraRig
from svv.core.volumes.classified import ClassifiedVolume, ValueGrid
from svv.errors import BadInput, Progress, part
from svv.fields.radiance.encodings import SparseLattice
from svv.fields.radiance.networks import FieldSettings
from svv.fields.radiance.occupancy import Occupancy
from svv.fields.radiance.time_steps import TimeSteps
from svv.fields.radiance.value_function import ValueFunction
from svv.fields.scene.scene import Scene
from svv.io.views.agreement import check_agreement
from svv.io.views.empty_views import check_shown
from svv.io.views.equal_views import equal_views
from svv.io.views.viewset import ViewSet
from svv.measure import let_go_in_commands, trim_memory
from svv.train.base.feature_levels import with_fewest_levels
from svv.train.base.finer_features import finer_for_normals
from svv.train.base.first_extinction import Beginning, begin, first_occupancy
from svv.train.base.from_values import ValueReconstruction, field_of
from svv.train.base.reconstruct import Reconstruction, reconstruct
from svv.train.base.resolutions import affordable_field, fitted_field
from svv.train.base.sampling import with_fewest
from svv.train.expected_errors import expected_errors
from svv.train.palette.doubts import doubts, hues_within, joined_ranges
from svv.train.palette.lighting import headlight_of, light_by_trial, light_for, shows_light
from svv.train.palette.ranges import KnownRegions, Labelled, regions_for, regions_of
from svv.train.palette.recolour import palette_of, recolour
from svv.train.palette.regions_from_views import regions_in
from svv.train.palette.unmix import Unmixing
from svv.train.run import ranks
from svv.train.run.checkpoint import Checkpoint
from svv.train.run.config import Preset
from svv.train.run.loop import Running

INDEPENDENT = 3
"""Palette colours that a pixel's colour alone can tell apart: RGB has no more dimensions, so more are unmixed."""

BEGINNING_PART = 0.2
"""Fraction of a time limit that reconstructing the extinction from views may take."""

BASE_PART = 0.68
"""Fraction of a time limit given to stage 1; stage 2 gets the rest, less the time of the steps between them."""

REGIONS_PART = 0.25
"""Fraction of what is then left that finding the regions without a volume may take."""


class Training:
    """Stages 1 and 2 of one scene.

    ``seconds``: duration of each part; ``notes``: what was chosen and why; ``warnings``: those of them that may mean a
    mistake in the views or in regions found without the volume, of which ``confidence`` has a number for each.
    """

    def __init__(
        self,
        views: ViewSet,
        chosen: Preset,
        limit: float | None,
        seed: int,
        progress: Progress,
        saved: Checkpoint | None,
        device: torch.device,
    ) -> None:
        """Prepare the training; the arguments are those of :func:`svv.train.pipeline.train_scene`."""
        self.views, self.chosen, self.limit, self.seed = views, chosen, limit, seed
        self.progress, self.saved, self.device = progress, saved, device
        self.seconds: dict[str, float] = {}
        self.notes: list[str] = []
        self.confidence: tuple[float, ...] = ()
        with self._timed("check"):
            empty = ranks.once(lambda: check_shown(views))
            drawn = views.classified is not None
            checked = ranks.once(lambda: check_agreement(views.cameras, views.images, views.names, drawn=drawn))
            told = checked.doubt, checked.fixed, ranks.once(lambda: equal_views(views)), empty
        self.warnings = [said for said in told if said is not None]

    @property
    def learned_from(self) -> str:
        """What the scene is learned from: ``volume and views`` or ``views only``."""
        return "volume and views" if self._volume is not None else "views only"

    @property
    def _volume(self) -> ClassifiedVolume | None:
        """The volume, if the views come with it and the settings use it; a hash grid takes only the regions from it."""
        return self.views.classified if self.chosen.reconstruct.use_volume else None

    @property
    def _values(self) -> ValueGrid | None:
        """The volume's values, if the scene is to be a function of them; raises BadInput if views come without."""
        if not self.chosen.values:
            return None
        if self._volume is None or self._volume.values is None:
            raise BadInput(
                "The encoding 'values' needs the values of the volume, which these views do not come with: draw views "
                "of the volume with `svv views`, or choose the encoding 'lattice'."
            )
        self._volume.values.check_between()
        return self._volume.values

    def run(self) -> Scene:
        """Return the trained scene; stages that the checkpoint holds are not repeated."""
        scene = self._restored_base() if self.saved and "base" in self.saved.finished else self._base()
        with self._timed("palette"):
            scene, palette, known = ranks.once(lambda: self._palette(scene))
        owners = None if known is None else known.owners
        given = None
        if owners is None and self.chosen.fitted and len(palette.colours) > INDEPENDENT:
            given = Unmixing(palette.colours, scene.device)
        scene = self._lit(scene, palette, owners, given)
        scene = self._recoloured(scene, palette, known, given)
        with self._timed("sampling"):
            how, reason = ranks.once(lambda: self._samples(scene))
        self.notes.append(reason)
        scene = replace(scene, **how)  # type: ignore[arg-type]
        with self._timed("doubt"):
            reconstructed, recoloured = self.chosen.reconstruct, self.chosen.recolour
            trained = reconstructed.iterations * reconstructed.rays + recoloured.iterations * recoloured.rays
            expected = ranks.once(lambda: expected_errors(scene, self.views, trained, self.seed))
        return replace(scene, expected=expected)

    def _samples(self, scene: Scene) -> tuple[dict[str, float], str]:
        """Return with which samples and colours images of the scene are good enough, and why."""
        if self.chosen.all_samples:
            joined = self.chosen.recolour.joined
            reason = f"images use every sample, merged up to 1/{1 / joined:g} of a pixel, as in the preset"
            return {"stride": 1.0, "joined": joined}, reason
        found, reason = with_fewest(scene, self.views)
        return {k: getattr(found, k) for k in ("stride", "joined", "vertices_a_cell")}, reason

    def _restored_base(self) -> Scene:
        assert self.saved is not None
        values = self.saved.finished["base"]
        self.seconds, self.notes = {**self.seconds, **values["seconds"]}, values["notes"]
        return Scene.from_arrays(values["header"], self.saved.arrays).on(self.device)

    def _base(self) -> Scene:
        """Train extinction and base colours (stage 1)."""
        views, chosen, progress = self.views, self.chosen, self.progress
        field, beginning = ranks.once(self._begun)
        trim_memory()  # what finding the extinction has freed
        left = self._left()
        first = None if left is None else max(0.1, left * BASE_PART)
        base, occupancy, marching, self.seconds["base"], reason = reconstruct(
            views, field, chosen.reconstruct, beginning,
            Running(self.seed, first, part(progress, 0.1, 0.7), self.saved, self.warnings), self.device,
            Reconstruction if beginning.values is None else ValueReconstruction,
        )  # fmt: skip
        self.notes.append(reason)
        self.notes.append(f"{occupancy.fraction:.1%} of the box is left after pruning empty cells")
        scene = Scene(field, occupancy, marching, base, camera_rig=CameraRig.of(views.cameras))
        if (own := beginning.values) is not None and base.extinction_table is not None:
            function = ValueFunction(own.interval, own.visible, occupancy.box.size, base.extinction_table)
            scene = replace(scene, values=function, steps=TimeSteps.of(own, occupancy.box))
        if self.saved is not None:
            header, arrays = scene.to_arrays(packed=False)
            self.saved.finish("base", {"header": header, "seconds": self.seconds, "notes": self.notes}, arrays)
        return scene

    def _begun(self) -> tuple[FieldSettings, Beginning]:
        """Return the shape of the networks and where training starts."""
        views, chosen = self.views, self.chosen
        with self._timed("hull"):
            occupancy, reason = first_occupancy(
                views, chosen.reconstruct, chosen.field, part(self.progress, 0.0, 0.02), self.device
            )
        self.notes += [f"learned from {self.learned_from}: {reason}", *self.warnings]
        field, values = replace(chosen.field, headlight=headlight_of(views)), self._values
        if values is not None:
            field = field_of(field, values)
            self.notes.append(f"the scene is a function of the volume's values, on a lattice of {values.cells} cells")
        elif chosen.fitted:
            field, reason = fitted_field(field, views.cameras, occupancy.box, chosen.reconstruct)
            self.notes.append(reason)
        beginning = replace(self._beginning(occupancy, field), values=values)
        if values is None and chosen.fitted:
            field, finer = finer_for_normals(field, views, beginning, chosen.reconstruct, self.seed)
            if finer is not None:
                self.notes.append(finer)
                beginning = self._beginning(occupancy, field)
            field, left_out = affordable_field(field, beginning.occupancy, chosen.reconstruct)
            self.notes += [] if left_out is None else [left_out]
        return field, beginning

    def _beginning(self, occupancy: Occupancy, field: FieldSettings) -> Beginning:
        """Return the extinction with which training starts; one that the views told is kept in the checkpoint."""
        saved, told = self.saved, part(self.progress, 0.02, 0.1)
        if saved is not None and "beginning" in saved.finished:
            values, arrays = saved.finished["beginning"], saved.arrays
            self.seconds["extinction"] = values["seconds"]
            self.notes.append(values["reason"])
            return Beginning.from_arrays(
                replace(occupancy, occupied=arrays["occupied"].astype(np.uint8, copy=False)), values["cells"], arrays
            )
        limit = None if self.limit is None else self.limit * BEGINNING_PART
        begun = time.monotonic()
        beginning, reason = begin(
            self.views, occupancy, field, self.chosen.reconstruct, self.seed, told, limit, self.device
        )
        if reason is not None and beginning.density is not None:
            self.seconds["extinction"] = time.monotonic() - begun
            self.notes.append(reason)
            if saved is not None:
                values = {"seconds": self.seconds["extinction"], "reason": reason,
                          "cells": beginning.density.resolutions[0]}  # fmt: skip
                saved.finish("beginning", values, beginning.to_arrays())
        return beginning

    def _palette(self, scene: Scene) -> tuple[Scene, Palette, KnownRegions | None]:
        """Find the palette and, except as in the paper, the regions; drop levels and light that the scene can spare."""
        views, seed, known, palette = self.views, self.seed, None, None
        if self._volume is not None:
            known = regions_of(self._volume, views, scene, seed)
            self.warnings += joined_ranges(self._volume.mixed_ranges(), known.ranges)
        else:
            palette = palette_of(views, scene.occupancy, seed, device=scene.device)
            if self.chosen.fitted and isinstance(scene.base.encoding, SparseLattice):
                left = self._left()
                known = regions_in(scene, views, palette, seed, None if left is None else left * REGIONS_PART)
        if self.chosen.fitted:
            borders = known is not None and len(known.ranges) > 1
            scene, reason = with_fewest_levels(scene, views, seed, borders)
            self.notes.append(reason)
        if known is not None:
            palette, self.confidence = known.palette, known.confidence
            self.warnings += [*doubts(palette.colours, known.confidence, known.questions), *hues_within(known.mixed)]
        assert palette is not None
        self.notes.extend(palette.steps)
        if self.chosen.fitted:
            lit, reason = shows_light(scene, views, seed)
            scene = replace(scene, settings=replace(scene.settings, lighting="network" if lit else "none"))
            self.notes.append(reason)
        return scene, palette, known

    def _lit(self, scene: Scene, palette: Palette, owners: Labelled | None, given: Unmixing | None) -> Scene:
        """Return the scene, with an explicit light if one was requested."""
        values = self._values is not None
        asked = self.chosen.lighting or light_for(self.views, scene.settings)
        if scene.settings.lighting != "network" or (asked == "network" and not values):
            return scene
        scene = replace(scene, settings=replace(scene.settings, lighting="phong"))
        if values:
            self.notes.append("an explicit light (Blinn-Phong), with the normals of the values")
            return scene
        if asked != "auto":
            self.notes.append("as requested, an explicit light (Blinn-Phong), which can be moved, replaces the network")
            return scene
        with self._timed("lighting"):
            left = self._left()
            running = Running(self.seed, None if left is None else left / 3.0, part(self.progress, 0.7, 0.76))
            scene, reason = light_by_trial(
                scene, self.views, palette.colours, self.chosen.recolour, running, owners, given
            )
        self.notes.append(reason)
        return scene

    def _recoloured(self, scene: Scene, palette: Palette, known: KnownRegions | None, given: Unmixing | None) -> Scene:
        """Train the palette network and find its regions (stage 2)."""
        owners = None if known is None else known.owners
        told = part(self.progress, 0.76 if "lighting" in self.seconds else 0.7, 1.0)
        network, shares, self.seconds["pcn"] = recolour(
            self.views, scene, palette.colours, self.chosen.recolour,
            Running(self.seed, self._left(), told, self.saved, self.warnings), owners, given, self._values,
        )  # fmt: skip
        return replace(
            scene,
            palette_network=network,
            regions=regions_for(network, shares, None if known is None else known.ranges),
        )

    def _left(self) -> float | None:
        """Return how many seconds of the limit are left, at least 0.1; None without a limit."""
        return None if self.limit is None else max(0.1, self.limit - sum(self.seconds.values()))

    @contextmanager
    def _timed(self, name: str) -> Iterator[None]:
        begin = time.monotonic()
        yield
        trim_memory()  # what a part has freed is for the next one
        let_go_in_commands()
        self.seconds[name] = time.monotonic() - begin
