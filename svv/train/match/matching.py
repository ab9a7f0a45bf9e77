"""Stage 3 as in the paper (StyleRF-VolVis, UCN and NPSE): a network is distilled, and its colours match features."""

from __future__ import annotations

from functools import partial

import numpy as np
import torch
from torch import Tensor

from svv.errors import Progress, part
from svv.fields.radiance.networks import UnrestrictedField
from svv.fields.scene.scene import Scene
from svv.styles.features import FeatureNetwork
from svv.train.match.distil import Distillation
from svv.train.match.style_loss import StyleLossSettings, StyleTarget
from svv.train.match.stylize import Stylization
from svv.train.paint.painting import Painting
from svv.train.paint.plan import Order
from svv.train.run.checkpoint import Checkpoint
from svv.train.run.config import MatchSettings
from svv.train.run.loop import Loop
from svv.train.run.previews import Show

PREFIX = "table_and_network."


class Matching(Painting):
    """Paints one scene by distillation and matching."""

    settings: MatchSettings

    def __init__(
        self, scene: Scene, order: Order, settings: MatchSettings, loss: StyleLossSettings, network: FeatureNetwork,
        seed: int, saved: Checkpoint | None, preview: Show | None,
    ) -> None:  # fmt: skip
        """Prepare the painting of regions by an order without inks; ``preview`` is called from time to time."""
        super().__init__(scene, order, settings, seed, saved, preview)
        self.loss, self.network, self.remarks.doubtful = loss, network, True
        self.refined = [k for k in order.pairs if order.go_on and scene.regions[k].style is not None]

    def run(self, progress: Progress) -> UnrestrictedField:
        """Paint the scene and return its colours; raises BadInput if none of the regions is visible."""
        targets = self._targets()
        field = self._distilled(targets, part(progress, 0.0, 0.3))
        work = Stylization(self.scene, field, targets, self.settings, part(progress, 0.3, 0.36))
        loop = self._loop(self.settings.style_iterations, part(progress, 0.36, 1.0), "stylization", field)
        self.seconds["stylize"] = self._run(loop, work, "stylize")
        return field

    def _targets(self) -> dict[int, StyleTarget]:
        order, network = self.order, self.network.to(self.scene.device)
        targets = {}
        for region, number in order.pairs.items():
            # torch does not accept mirrored views of arrays
            picture = torch.from_numpy(np.ascontiguousarray(order.styles[number], np.float32))
            mask = None if (own := order.masks[number]) is None else torch.from_numpy(own)
            style = picture.to(self.scene.device).permute(2, 0, 1)
            targets[region] = StyleTarget(network, style, self.loss, self.seed, mask)
        return targets

    def _distilled(self, targets: dict[int, StyleTarget], progress: Progress) -> UnrestrictedField:
        """Return the network from which the matching starts: distilled, or the scene's own where it is refined."""
        scene, before = self.scene, self.scene.styled if self.order.go_on else None
        work = Distillation(scene, self._transferred(targets), self.settings, self.seed, before)
        if before is not None and not before.direct and len(self.refined) == len(targets):
            return work.field
        loop = self._loop(self.settings.distil_iterations, progress, "distillation", work.field)
        self.seconds["distil"] = self._run(loop, work, "distil")
        return work.field

    def _transferred(self, targets: dict[int, StyleTarget]) -> Tensor:
        """Return the regions' colours with the mean colours of their styles. (regions, 3)"""
        assert self.scene.palette_network is not None
        colours = self.scene.palette_network.colours.detach()[self.scene.roots]
        for region, target in targets.items() if self.settings.colour_transfer else ():
            colours[region] = target.statistics[0]
        return colours

    def _loop(self, steps: int, progress: Progress, label: str, field: UnrestrictedField) -> Loop:
        watch = None if self.previews is None else partial(self.previews.look, field)
        return Loop(steps, None, progress, label, watch=watch, network=field, notes=self.remarks.notes)

    def _run(self, loop: Loop, work: Distillation | Stylization, name: str) -> float:
        """Run a part, or take its result from the checkpoint; returns the seconds spent."""
        saved = self.saved
        if saved is None:
            return loop.run(work.step)
        if name in saved.finished:
            cut = len(PREFIX)
            state = {k[cut:]: torch.from_numpy(v.copy()) for k, v in saved.arrays.items() if k.startswith(PREFIX)}
            work.field.load_state_dict(state)
            return float(saved.finished[name]["seconds"])
        kept = saved.stage(name, work.field, work.networks, work.tables)
        if kept.restored is not None:
            loop.done, loop.spent = kept.restored
        loop.save = lambda done, spent: kept.save(done, spent, {})
        seconds = loop.run(work.step)
        found = {PREFIX + k: v.cpu().numpy().copy() for k, v in work.field.state_dict().items()}
        saved.finish(name, {"seconds": seconds}, found)
        return seconds
