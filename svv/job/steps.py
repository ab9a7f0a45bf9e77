"""Steps of the whole job: views, training, scores, edits, stylization, and orbits side by side.

``svv demo`` and ``svv run`` are this job with different sources. A stage that was already done under the same settings
is skipped (see :mod:`svv.job.stages`).
"""

from __future__ import annotations

import colorsys
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from svv.errors import Progress, part
from svv.fields.devices.gpu import device_named
from svv.fields.scene.scene import Scene
from svv.io.files.atomic import make_folder, write_json
from svv.io.files.keyed_results import digest
from svv.io.pictures.output import is_frame, write_mp4, write_png, write_region_png
from svv.io.pictures.style_picture import read_style
from svv.io.scene_file import checkpoint_of, remove_checkpoints
from svv.io.views.agreement import check_agreement
from svv.io.views.transforms import transforms_file
from svv.io.views.viewset import ViewSet
from svv.job.looks.file import to_json
from svv.job.looks.look import Look
from svv.job.request import Paint, Request, learn, paint
from svv.job.source import Drawn, ViewSource
from svv.job.stages import Stages, fingerprint
from svv.measure import usable_cpus
from svv.options.described import chosen
from svv.options.making import OrbitOptions, PaintOptions, SharingOptions, TrainOptions, ViewOptions
from svv.render.frames import orbit, region_colours, write_frames_of
from svv.render.pictures import cropped, error_picture, fitted, over_white, read_png, sheet, shrunk
from svv.render.web.page import write_html
from svv.train.paint.ink import StyleInput
from svv.train.pipeline import evaluate_scene

HUE_TURN = 0.42
"""Fraction of the hue circle by which the recoloured orbit turns each region: enough to be obvious."""

TRUTH = "volume rendering"
"""Label of the orbit of the volume itself."""

CONTACT_ROWS = 4
UNSEEN_ROWS = 3
FPS = 15.0


@dataclass(frozen=True)
class JobSettings:
    """Settings of a job, apart from its source and its styles."""

    views: ViewOptions = ViewOptions()
    train: TrainOptions = TrainOptions()
    path: OrbitOptions = OrbitOptions()
    recolour: bool = False
    """Whether to include a recoloured scene."""
    look: Look | None = None
    """The look of the scene, in place of styles."""
    sharing: SharingOptions = SharingOptions()
    """Which region gets which style, or part of one."""

    @property
    def paint(self) -> PaintOptions:
        """Options for painting the regions: preset and seed of the training."""
        return PaintOptions(**vars(self.sharing), preset=self.train.preset, seed=self.train.seed)


class Job:
    """One job in one folder; call its steps in the order of :func:`svv.job.run.run_job`."""

    def __init__(
        self, source: Drawn | ViewSource, styles: Sequence[Path], out: Path, settings: JobSettings, stages: Stages
    ) -> None:
        self.source, self.styles, self.settings, self.stages = source, list(styles), settings, stages
        self.out = out
        self.views = source.folder if isinstance(source, ViewSource) else out / "views"
        self.scene = out / "scene.svv"
        self.variants: dict[str, tuple[str, Path | None]] = {}
        """Name of a column of the orbit -> its stage and its scene file (None for the volume renderings)."""

    def scene_at(self, path: Path) -> Scene:
        """Load a scene onto the device given in the settings."""
        return Scene.load(path).on(device_named(self.settings.train.device))

    @property
    def has_unseen(self) -> bool:
        """Whether there are test views; any that another job left in the folder do not count."""
        if isinstance(self.source, Drawn):
            return self.settings.views.test > 0
        return transforms_file(self.views, "test") is not None

    def make_views(self) -> None:
        """Draw the training and test views, unless the source provides views."""
        source, s = self.source, self.settings.views
        if isinstance(source, ViewSource):
            self.stages.do("views", "Views", source.identity(), [], lambda progress: None)
            return
        files = [self.views / "transforms_train.json"] + [self.views / "transforms_test.json"] * (s.test > 0)
        self.stages.do(
            "views",
            f"Drawing {s.n} + {s.test} views",
            {**source.identity(), **chosen(s)},
            files,
            lambda progress: source.make_views(self.views, s, progress),
        )

    def train(self) -> None:
        """Train the scene."""
        options, checkpoint = self.settings.train, checkpoint_of(self.scene)

        def work(progress: Progress) -> None:
            if self.has_unseen and not isinstance(self.source, Drawn):  # before the training, not after it
                unseen = ViewSet.read(self.views, "test")
                check_agreement(unseen.cameras, unseen.images, unseen.names, "the split test")
            views = ViewSet.read(self.views, "train", part(progress, 0.0, 0.01))
            scene, report = learn(Request(views, train=options), part(progress, 0.01, 1.0), checkpoint)
            scene.save(self.scene)
            write_json(self.out / "train.json", {**report, "scene_bytes": self.scene.stat().st_size})
            checkpoint.unlink(missing_ok=True)

        self.stages.do("train", "Training", chosen(options), [self.scene, self.out / "train.json"], work, ["views"])

    def evaluate(self) -> None:
        """Score the base and palette networks on the test views, and show some renderings beside the ground truth."""
        if not self.has_unseen:
            return

        def work(progress: Progress) -> None:
            views = ViewSet.read(self.views, "test", part(progress, 0.0, 0.05))
            scene = self.scene_at(self.scene)
            scores = {
                "base": evaluate_scene(scene, views, "base", part(progress, 0.05, 0.45)),
                "pcn": evaluate_scene(scene, views, "pcn", part(progress, 0.45, 0.85)),
            }
            self._show_unseen(scene, views, part(progress, 0.85, 1.0))
            write_json(self.out / "scores.json", {name: found.to_json() for name, found in scores.items()})

        files = [self.out / "scores.json", self.out / "unseen.png"]
        self.stages.do("evaluate", "Scores on unseen views", {}, files, work, ["train"])

    def regions(self) -> None:
        """Render the region map and each region alone."""

        def work(progress: Progress) -> None:
            scene = self.scene_at(self.scene)
            size = self.settings.path.orbit_size
            camera = orbit(scene, 181, size, size)[76]
            count = len(scene.regions)
            first = scene.render(camera, "pcn", None, part(progress, 0.0, 1 / (count + 1)))
            write_region_png(self.out / "region-map.png", first.region, region_colours(scene))
            pictures, labels = [over_white(first.rgba)], ["all regions"]
            for kept in range(count):
                alone = scene
                for other in set(range(count)) - {kept}:
                    alone = alone.edited(other, None, 0.0, None)
                step = part(progress, (kept + 1) / (count + 1), (kept + 2) / (count + 1))
                pictures.append(over_white(alone.render(camera, "pcn", None, step).rgba))
                labels.append(f"region {kept}")
            write_png(self.out / "regions.png", sheet(cropped([pictures]), labels))

        settings = {"size": self.settings.path.orbit_size}
        files = [self.out / "regions.png", self.out / "region-map.png"]
        self.stages.do("regions", "Regions", settings, files, work, ["train"])

    def recolour(self) -> None:
        """Shift the hue of every region."""
        path = self.out / "recoloured.svv"

        def work(progress: Progress) -> None:
            scene = Scene.load(self.scene)
            for index, region in enumerate(scene.regions):
                scene = scene.edited(index, turned(region.colour), None, None)
            scene.save(path)

        self.stages.do("recolour", "Recolouring", {"turn": HUE_TURN}, [path], work, ["train"])
        self.variants["recoloured"] = ("recolour", path)

    def stylize(self) -> None:
        """Paint the regions in the manner of the styles."""
        options, path = self.settings.paint, self.out / "styled.svv"
        checkpoint, size = checkpoint_of(path), self.settings.path.orbit_size
        settings = {"styles": [fingerprint(style) for style in self.styles], **chosen(options)}

        def work(progress: Progress) -> None:
            styles = [StyleInput(read_style(style), style.stem) for style in self.styles]
            base = self.scene_at(self.scene)
            request = Request(base, paint=Paint.of(styles, options), device=self.settings.train.device)
            scene, report = paint(request, base, progress, checkpoint)
            scene.save(path)
            shown = [fitted(read_style(style), size) for style in self.styles]
            write_png(self.out / "styles.png", sheet([shown], [style.stem for style in self.styles]))
            write_json(self.out / "stylize.json", {**report, "scene_bytes": path.stat().st_size})
            remove_checkpoints(checkpoint, len(scene.layers) + 1)

        files = [path, self.out / "styles.png", self.out / "stylize.json"]
        self.stages.do("stylize", "Stylizing", settings, files, work, ["train"])
        self.variants["styled"] = ("stylize", path)

    def give_look(self) -> None:
        """Give the scene its look."""
        look, path, options = self.settings.look, self.out / "styled.svv", self.settings.paint
        assert look is not None
        checkpoint = checkpoint_of(path)

        def work(progress: Progress) -> None:
            found = look.applied(
                self.scene_at(self.scene), None, progress, checkpoint, preset=options.preset, seed=options.seed
            )
            found.scene.save(path)
            told = {"matches": found.matches.describe(look, found.scene), "notes": found.notes}
            write_json(self.out / "look.json", told)

        settings = {"look": digest(to_json(look)), **chosen(options)}
        self.stages.do("look", "Look", settings, [path, self.out / "look.json"], work, ["train"])
        self.variants["styled"] = ("look", path)

    def share(self) -> None:
        """Write the scene, painted if there are styles, as a page that a browser turns."""
        stage, path = self.variants.get("styled", ("train", self.scene))
        page, source = self.out / "scene.html", self.source
        title = Path(source.name).stem if isinstance(source, Drawn) else source.folder.name

        def work(progress: Progress) -> None:
            write_html(page, self.scene_at(path or self.scene), title, progress=progress)

        self.stages.do("share", "Page for browsers", {}, [page], work, [stage])

    def orbits(self) -> None:
        """Render the orbit of each variant, frame by frame, into a separate folder."""
        source, s = self.source, self.settings.path
        settings = {"frames": s.orbit, "size": s.orbit_size}
        columns: dict[str, tuple[str, Path | None]] = {"palette network": ("train", self.scene), **self.variants}
        if isinstance(source, Drawn):
            columns = {TRUTH: ("views", None), **columns}
        self.variants = columns
        scenes = {self._frames(label): path for label, (_, path) in columns.items() if path is not None}

        def draw(progress: Progress) -> None:
            assert isinstance(source, Drawn)
            cameras, folder = orbit(self.scene_at(self.scene), s.orbit, s.orbit_size, s.orbit_size), self._frames(TRUTH)
            make_folder(folder)
            for old in filter(is_frame, folder.iterdir()):  # of an orbit of more frames, or of another volume
                old.unlink()
            files = [folder / f"{index:04d}.png" for index in range(s.orbit)]
            with ThreadPoolExecutor(usable_cpus()) as pool:
                list(pool.map(write_png, files, source.truth(self.views, cameras, progress)))

        def render(progress: Progress) -> None:
            shown = {folder: self.scene_at(path) for folder, path in scenes.items()}
            cameras = orbit(next(iter(shown.values())), s.orbit, s.orbit_size, s.orbit_size)
            write_frames_of(shown, cameras, progress)

        frames = [f"{index:04d}.png" for index in range(s.orbit)]
        if TRUTH in columns:
            files = [self._frames(TRUTH) / frame for frame in frames]
            self.stages.do(f"orbit {TRUTH}", f"Orbit: {TRUTH}", settings, files, draw, ["train", "views"])
        stages = sorted({"train", *(stage for stage, path in columns.values() if path is not None)})
        files = [folder / frame for folder in scenes for frame in frames]
        names = ", ".join(label for label in columns if label != TRUTH)
        self.stages.do("orbits", f"Orbits: {names}", {**settings, "of": names}, files, render, stages)

    def movie(self) -> None:
        """Combine the orbits side by side, as a movie and as a contact sheet."""
        s, labels = self.settings.path, list(self.variants)
        contact, movie = self.out / "contact.png", self.out / "orbit.mp4"
        rows = [int(i) for i in np.linspace(0, s.orbit - 1, CONTACT_ROWS + 2).round()][1:-1]

        def frame(index: int) -> list[NDArray[np.uint8]]:
            return [over_white(read_png(self._frames(label) / f"{index:04d}.png")) for label in labels]

        def work(progress: Progress) -> None:
            write_png(contact, sheet(cropped([frame(index) for index in rows]), labels))

            def frames() -> Iterator[NDArray[np.uint8]]:
                for index in range(s.orbit):
                    yield sheet([frame(index)], labels)
                    progress((index + 1) / s.orbit, f"frame {index + 1} of {s.orbit}")

            write_mp4(movie, frames(), FPS)

        after = ["orbits", *([f"orbit {TRUTH}"] if TRUTH in labels else [])]
        self.stages.do("movie", "Side by side", {"fps": FPS}, [contact, movie], work, after)

    def _frames(self, label: str) -> Path:
        return self.out / "orbit" / label.replace(" ", "-")

    def _show_unseen(self, scene: Scene, views: ViewSet, progress: Progress) -> None:
        rows, size = [], self.settings.path.orbit_size
        some = np.linspace(0, len(views) - 1, UNSEEN_ROWS + 2).round().astype(int)[1:-1]
        for step, index in enumerate(some):
            progress(step / len(some), "unseen views")
            camera = views.cameras[index]
            height = round(size * camera.height / camera.width)
            truth = over_white(shrunk(views.images[index], size, height))
            small = camera.resized(size, height)
            pictures = [over_white(scene.render(small, name, None).rgba) for name in ("base", "pcn")]
            rows.append([truth, *pictures, error_picture(truth, pictures[1])])
        labels = ["volume rendering", "base network", "palette network", "its error x 4"]
        write_png(self.out / "unseen.png", sheet(cropped(rows), labels))


def turned(colour: Sequence[float] | NDArray[np.float32]) -> tuple[float, float, float]:
    """Shift a colour's hue by ``HUE_TURN``; dull and dark colours are first given some saturation and brightness."""
    hue, saturation, value = colorsys.rgb_to_hsv(*(float(c) for c in colour))
    return colorsys.hsv_to_rgb((hue + HUE_TURN) % 1.0, max(saturation, 0.35), max(value, 0.35))
