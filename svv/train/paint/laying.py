"""Stage 3 of a scene whose paint is laid: strokes, pieces of pictures and ink. It needs no weights and no training."""

from __future__ import annotations

import time
from functools import partial

import numpy as np
import torch
from torch import Tensor

from svv.errors import Progress, part
from svv.fields.radiance.networks import UnrestrictedField
from svv.fields.scene.scene import Scene
from svv.train.base.resolutions import paint_pixel
from svv.train.paint.contrast import match_contrast, stroke_scales
from svv.train.paint.ink import PAPER
from svv.train.paint.painting import Painting, Start, painted_field, painted_start
from svv.train.paint.pieces import PieceSettings, PieceStyle, piece_style
from svv.train.paint.pieces_apart import keep_pieces_apart
from svv.train.paint.plan import Order
from svv.train.paint.style_choice import mean_colour
from svv.train.run.checkpoint import Checkpoint
from svv.train.run.config import StylizeSettings
from svv.train.run.previews import Show

PIECES_LAID = 0.9
"""Fraction of the work after which pieces are laid; the contrast of their paint is the rest."""


class Laying(Painting):
    """Lays the paint of one scene."""

    def __init__(
        self, scene: Scene, order: Order, settings: StylizeSettings, pieces: PieceSettings, seed: int,
        saved: Checkpoint | None, preview: Show | None,
    ) -> None:  # fmt: skip
        """Prepare the painting; ``saved`` keeps laid pieces, and ``preview`` is called after each region."""
        super().__init__(scene, order, settings, seed, saved, preview)
        self.pieces = pieces

    def run(self, progress: Progress) -> UnrestrictedField:
        """Paint the scene and return its colours; raises BadInput if none of the regions is visible."""
        styles = self._styles()
        solved = bool(styles) and self.pieces.contrast
        end = PIECES_LAID if solved else 1.0
        begin = time.monotonic()
        field = self._laid(styles, part(progress, 0.0, end))
        self.seconds["paint"] = time.monotonic() - begin
        if solved:
            match_contrast(self.scene, field, styles, self.settings, part(progress, end, 1.0))
            self.seconds["contrast"] = time.monotonic() - begin - self.seconds["paint"]
        if styles:
            pictures = {k: self.order.styles[self.order.pairs[k]] for k in styles}
            flats, told = self._transferred(styles), part(progress, 1.0, 1.0)
            self.remarks.doubtful |= keep_pieces_apart(self.scene, field, pictures, self.order.named, flats, told)
        return field

    def _laid(self, styles: dict[int, PieceStyle], progress: Progress) -> UnrestrictedField:
        """Return the paint before its contrast is solved, from the checkpoint if that holds it."""
        scene, order, pixel = self.scene, self.order, paint_pixel(self.scene, self.settings)
        # Strokes take less time than it would take to keep them: they are laid again, and are the same.
        saved = None if order.hands else self.saved
        if saved is not None and "paint" in saved.finished:
            field = painted_field(scene, pixel)
            field.load_state_dict({k: torch.from_numpy(v.copy()) for k, v in saved.arrays.items()})
            return field
        start = Start(
            self._transferred(styles), styles, order.inks, order.hands, order.size, self.settings.style_views,
            scene.styled if order.go_on else None,
        )  # fmt: skip
        show = (lambda field: None) if self.previews is None else partial(self.previews.look, at_once=True)
        field = painted_start(scene, start, pixel, self.seed, progress, show, self.remarks)
        if saved is not None:
            saved.finish("paint", {}, {k: v.cpu().numpy().copy() for k, v in field.state_dict().items()})
        return field

    def _styles(self) -> dict[int, PieceStyle]:
        """Return the picture of each region that is painted by pieces; deep regions get larger strokes."""
        order, scene = self.order, self.scene
        pictures = {k: order.styles[v] for k, v in order.pairs.items() if k not in order.inks and k not in order.hands}
        if not pictures:
            return {}
        larger = stroke_scales(scene, list(pictures), paint_pixel(scene, self.settings), self.pieces.largest)
        return {
            k: piece_style(p, order.masks[order.pairs[k]], self.pieces, larger.get(k, 1.0), self.seed, scene.device)
            for k, p in pictures.items()
        }

    def _transferred(self, styles: dict[int, PieceStyle]) -> Tensor:
        """Return the regions' colours where no paint reaches: their pictures' means, or paper. (regions, 3)"""
        assert self.scene.palette_network is not None
        colours = self.scene.palette_network.colours.detach()[self.scene.roots]
        for region, style in styles.items():
            colours[region] = style.mean
        for region in self.order.inks:
            colours[region] = colours.new_tensor(PAPER)
        for region in self.order.hands:
            number = self.order.pairs[region]
            mean = mean_colour(self.order.styles[number], self.order.masks[number])
            colours[region] = colours.new_tensor(np.asarray(mean, np.float32))
        return colours
