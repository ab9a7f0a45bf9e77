"""The cases of ``svv bench stability``: their scenes, settings and measures."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from vtkmodules.vtkCommonDataModel import vtkImageData

from svv.core.colour.colour import WHITE, colour_differences, over
from svv.core.colour.correction import Correction
from svv.core.geometry.cameras import Camera
from svv.core.images.metrics import Likeness
from svv.dvr.draw.views import make_views, render_views
from svv.dvr.functions.transfer_functions import TransferFunction
from svv.errors import BadInput, Progress, part
from svv.fields.radiance.rendering import march
from svv.fields.scene.scene import Scene
from svv.io.views.view_meta import known
from svv.io.views.viewset import ViewSet
from svv.train.correct import correct_palette
from svv.train.pipeline import stylize_scene, train_scene
from svv.train.run.config import MatchSettings, Preset
from svv_bench.stability.measures import matched, overlaps, palette_error
from svv_bench.stability.pictures import barely_masked, dark, flat, grey, tiny
from svv_bench.stability.scenes import SCENES, TRANSPARENT, KnownScene

Measures = dict[str, Any]
"""Results of a run: ``psnr``, ``psnr_foreground``, ``base_foreground``, ``dvr_foreground``, ``overlap`` (mean) and
``overlaps``, ``colour_error``, ``regions``, ``ranges``, ``finite``; for some cases ``lost``, ``style_error``,
``refused``."""

FINER = 4
"""Rays along each side of a pixel of the DVR that the views are compared with (``dvr_foreground``)."""

INSIDE, NEAR, FAR = 0.05, 0.4, 4.0
"""Distances of cameras from the scene's middle, as fractions of the training cameras'. The first are in the hole of
the easy scene's ring; a camera inside its matter would see surfaces that no view shows."""

WIDE = np.pi / 2
"""Field of view from inside, in radians."""

LARGER = 3
"""Factor on the size of the views in the test with views larger than those of training."""

ROUNDING = 1e-5
"""What sums of weights may add to a colour: 1.0000001 is no colour out of gamut."""

STYLE_STEPS: dict[str, Any] = {"distil_iterations": 100, "style_iterations": 20, "style_views": 20}
"""Settings that shorten the preset ``paper``: the only question is whether paint stays in bounds."""


@dataclass(frozen=True)
class BenchSettings:
    """Settings that all runs share."""

    n: int = 92
    """Number of training views, unless the case has its own."""
    test: int = 6
    """Number of unseen views for the scores."""
    size: int = 200
    """Width and height of the views in pixels."""
    resolution: int = 64
    """Voxels along each side of a volume."""
    time_limit: float | None = None
    """Time limit of training per run in seconds, the same for each preset; None for the presets' own steps."""
    steps: tuple[tuple[str, int, int], ...] = ()
    """(preset, steps of stage 1, of stage 2) instead of the preset's own steps and of the time limit."""
    samples: int | None = None
    """Maximum number of visible samples per step, with an eighth as many rays; None for the preset's numbers."""

    def applied(self, preset: Preset) -> tuple[Preset, float | None]:
        """Return the preset with these settings, and its time limit in seconds if it has one."""
        base, palette = preset.reconstruct, preset.recolour
        if self.samples is not None:
            rays = max(1, self.samples // 8)
            base = replace(base, samples=self.samples, rays=rays)
            palette = replace(palette, samples=self.samples, rays=rays)
        for name, first, second in self.steps:
            if name == preset.name:
                base, palette = replace(base, iterations=first), replace(palette, iterations=second)
                return replace(preset, reconstruct=base, recolour=palette), None
        return replace(preset, reconstruct=base, recolour=palette), self.time_limit


@dataclass(frozen=True)
class Drawn:
    """A scene's volume and views, with their ground truth."""

    known: KnownScene
    volume: vtkImageData
    train: ViewSet
    test: ViewSet
    classes: NDArray[np.int16]
    """Class of each pixel of the test views; see :meth:`KnownScene.class_maps`."""
    dvr_foreground: float
    """Foreground PSNR of the DVR itself with ``FINER`` x ``FINER`` rays a pixel, see :func:`finer_dvr`, in dB."""

    def seen_by(self, cameras: Sequence[Camera]) -> Drawn:
        """Return the scene with test views from other cameras."""
        function = self.known.transfer_function()
        images = render_views(self.volume, function, cameras, "cpu")
        test = ViewSet(tuple(cameras), images, tuple(str(k) for k in range(len(cameras))))
        classes = self.known.class_maps(self.volume, cameras)
        return replace(self, test=test, classes=classes, dvr_foreground=finer_dvr(self.volume, function, test))


class Bench:
    """Draws scenes and trains on them; caches results that the next run may need again."""

    def __init__(self, settings: BenchSettings) -> None:
        self.settings = settings
        self._drawn: dict[tuple[str, int], Drawn] = {}
        self._trained: tuple[Any, Scene] | None = None

    def drawn(self, scene: str, views: int, progress: Progress) -> Drawn:
        """Return the views of a known scene."""
        if (scene, views) not in self._drawn:
            s, known = self.settings, SCENES[scene]
            volume = known.volume(s.resolution)
            train, test = make_views(volume, known.transfer_function(), n=views, size=s.size, test=s.test, mapper="cpu",
                                     rescale=False, name=scene, progress=progress)  # fmt: skip
            assert test is not None
            classes = known.class_maps(volume, test.cameras)
            finer = finer_dvr(volume, known.transfer_function(), test)
            self._drawn[scene, views] = Drawn(known, volume, train, test, classes, finer)
        return self._drawn[scene, views]

    def trained(self, case: Case, preset: Preset, seed: int, progress: Progress) -> tuple[Drawn, Scene]:
        """Return a case's views and the scene trained on them; the last scene is cached for cases that share it."""
        views = case.views or self.settings.n
        drawn = self.drawn(case.scene, views, part(progress, 0.0, 0.1))
        if case.views_only:
            drawn = replace(drawn, train=replace(drawn.train, classified=None))
        changed = case.change(preset)
        key = case.scene, views, changed, seed, case.views_only
        if self._trained is None or self._trained[0] != key:
            self._trained = None
            applied, limit = self.settings.applied(changed)
            scene, _ = train_scene(drawn.train, applied, part(progress, 0.1, 0.9), time_limit=limit, seed=seed)
            self._trained = key, scene
        return drawn, self._trained[1]


@dataclass(frozen=True)
class Case:
    """A situation in which something may go wrong. Cases that differ only in ``measure`` share one training."""

    title: str
    measure: Callable[[Bench, Case, Preset, int, Progress], Measures]
    scene: str = "easy"
    """One of :data:`svv_bench.stability.scenes.SCENES`."""
    views: int | None = None
    """Number of training views; None for the usual number."""
    change: Callable[[Preset], Preset] = lambda preset: preset
    """Change of the preset's settings."""
    encoding: str | None = None
    """Encoding that a preset must have for the case to apply; None for any."""
    views_only: bool = False
    """Whether training uses only the images, without the volume."""

    def concerns(self, preset: Preset) -> bool:
        """Return whether the case applies to a preset."""
        return self.encoding in (None, preset.field.encoding)


# --- measures ----------------------------------------------------------------------------------------------------


def finer_dvr(volume: vtkImageData, function: TransferFunction, views: ViewSet) -> float:
    """Return the foreground PSNR of the DVR with ``FINER`` x ``FINER`` rays a pixel, over white, on views, in dB.

    The views have one ray a pixel, so edges in them are jagged. What no scene without jagged edges can exceed is not
    lost in training.
    """
    scores = []
    for camera, truth in zip(views.cameras, views.images, strict=True):
        height, width = truth.shape[:2]
        (fine,) = render_views(volume, function, [camera.resized(FINER * width, FINER * height)], "cpu")
        colour = over(fine / np.float32(255), WHITE).reshape(height, FINER, width, FINER, 3).mean(axis=(1, 3))
        scores.append(Likeness.of(colour, truth))
    return Likeness.mean(scores).psnr_foreground


def as_saved(scene: Scene) -> Scene:
    """Return the scene as it would be read from its file."""
    return Scene.from_bytes(scene.to_bytes())


def scores(scene: Scene, drawn: Drawn) -> Measures:
    """Score a scene against the truth on test views, by the protocol of :func:`svv.train.evaluate.evaluate_scene`."""
    known, classes = drawn.known, drawn.classes
    ours, theirs, maps, finite = [], [], [], True
    for camera, truth in zip(drawn.test.cameras, drawn.test.images, strict=True):
        view = scene.render(camera, "pcn")
        base = scene.render(camera, "base", WHITE).rgba[..., :3]
        finite &= bool(np.isfinite(view.rgba).all() and np.isfinite(base).all())
        ours.append(Likeness.of(over(view.rgba, WHITE), truth))
        theirs.append(Likeness.of(base, truth))
        maps.append(view.region)
    table = overlaps(classes, np.stack(maps), len(known.ranges), len(scene.regions))
    each = matched(table)
    colours = np.array([r.colour for r in scene.regions])
    mean = Likeness.mean(ours)
    return {
        "psnr": mean.psnr,
        "psnr_foreground": mean.psnr_foreground,
        "base_foreground": Likeness.mean(theirs).psnr_foreground,
        "dvr_foreground": drawn.dvr_foreground,
        "finite": finite,
        "overlap": float(np.mean(each)),
        "overlaps": each,
        "colour_error": palette_error(colours, np.array([r.colour for r in known.ranges])),
        "regions": len(scene.regions),
        "ranges": len(known.ranges),
        "colours": colours.tolist(),
    }


def on_unseen_views(bench: Bench, case: Case, preset: Preset, seed: int, progress: Progress) -> Measures:
    """Measure the usual scores."""
    drawn, scene = bench.trained(case, preset, seed, progress)
    return scores(as_saved(scene), drawn)


def corrected_by_hand(bench: Bench, case: Case, preset: Preset, seed: int, progress: Progress) -> Measures:
    """Measure the scores after the palette was set to the transfer function's colours by hand.

    ``found`` is the number of regions before the correction.
    """
    drawn, scene = bench.trained(case, preset, seed, part(progress, 0.0, 0.6))
    truth = np.array([r.colour for r in drawn.known.ranges])
    which, own = linear_sum_assignment(colour_differences(truth, np.array([r.colour for r in scene.regions])))
    correction = Correction(
        remove=tuple(sorted(set(range(len(scene.regions))) - set(own.tolist()))),
        colours={int(k): drawn.known.ranges[r].colour for r, k in zip(which, own, strict=True)},
        add=tuple(r.colour for k, r in enumerate(drawn.known.ranges) if k not in which),
    )
    applied, limit = bench.settings.applied(case.change(preset))
    after, _ = correct_palette(
        scene, drawn.train, correction, applied, part(progress, 0.6, 1.0), time_limit=limit, seed=seed
    )
    return {**scores(as_saved(after), drawn), "found": len(scene.regions)}


def before_and_after_saving(bench: Bench, case: Case, preset: Preset, seed: int, progress: Progress) -> Measures:
    """Measure the scores of the saved scene, with tables in bytes or half precision, and the loss ``lost`` in dB."""
    drawn, scene = bench.trained(case, preset, seed, progress)
    after = scores(as_saved(scene), drawn)
    before = scores(scene, drawn)
    return {**after, "lost": before["psnr_foreground"] - after["psnr_foreground"]}


def from_cameras(place: Callable[[Bench, Drawn], Sequence[Camera]]) -> Callable[..., Measures]:
    """Return a measure of the scores on views from other cameras than the usual ones."""

    def measure(bench: Bench, case: Case, preset: Preset, seed: int, progress: Progress) -> Measures:
        drawn, scene = bench.trained(case, preset, seed, progress)
        return scores(as_saved(scene), drawn.seen_by(place(bench, drawn)))

    return measure


def at_distance(factor: float, fov: float | None = None) -> Callable[[Bench, Drawn], list[Camera]]:
    """Return a function that places cameras on the test path at another distance from the middle."""

    def place(bench: Bench, drawn: Drawn) -> list[Camera]:
        rig, s = known(drawn.train.meta.rig, "rig"), bench.settings
        moved = replace(rig, radius=factor * rig.radius, fov_x=fov or rig.fov_x)
        return moved.orbit(s.test + 2, s.size)[1:-1]

    return place


def larger(bench: Bench, drawn: Drawn) -> list[Camera]:
    """Return the test cameras with larger images."""
    side = LARGER * bench.settings.size
    return [camera.resized(side, side) for camera in drawn.test.cameras]


def refusal(bench: Bench, case: Case, preset: Preset, seed: int, progress: Progress) -> Measures:
    """Check whether a transfer function that shows nothing is refused in one sentence."""
    volume = TRANSPARENT.volume(bench.settings.resolution)
    try:
        make_views(volume, TRANSPARENT.transfer_function(), n=12, size=32, mapper="cpu", rescale=False)
    except BadInput as error:
        text = str(error)
        return {"refused": "transparent" in text and text.endswith(".") and "\n" not in text, "sentence": text}
    return {"refused": False}


def painted_like(picture: Callable[[], NDArray[np.float32]]) -> Callable[..., Measures]:
    """Return a measure of a stylization: whether it is finite and in gamut, and the error of its mean colour."""

    def measure(bench: Bench, case: Case, preset: Preset, seed: int, progress: Progress) -> Measures:
        drawn, scene = bench.trained(case, preset, seed, part(progress, 0.0, 0.6))
        style = picture()
        stylize = replace(preset.stylize, style_size=bench.settings.size)
        if isinstance(stylize, MatchSettings):
            stylize = replace(stylize, **STYLE_STEPS)
        short = replace(preset, stylize=stylize)
        styled, _ = stylize_scene(scene, [style], short, part(progress, 0.6, 1.0), seed=seed)
        styled = as_saved(styled)
        for region in range(len(styled.regions)):
            styled = styled.edited(region, lighting=0.0)  # the paint itself
        camera = drawn.test.cameras[len(drawn.test.cameras) // 2]
        rays = styled.caster([camera]).view(0)
        samples = march(rays, styled.occupancy, styled.base.density, styled.marching_for_images)
        colour = styled.shade(samples, rays, "styled")[0].numpy()
        rgba = styled.render(camera).rgba
        mean = rgba[rgba[..., 3] > 0.5][:, :3].mean(axis=0, keepdims=True)
        return {
            "finite": bool(np.isfinite(colour).all() and np.isfinite(rgba).all()),
            "in_gamut": bool((colour >= -ROUNDING).all() and (colour <= 1.0 + ROUNDING).all()),
            "style_error": float(colour_differences(mean, style.mean(axis=(0, 1))[None])[0, 0]),
        }

    return measure


# --- the list ----------------------------------------------------------------------------------------------------


def offset_weight(value: float) -> Callable[[Preset], Preset]:
    """Return a change of the preset to another lambda_delta."""
    return lambda preset: replace(preset, recolour=replace(preset.recolour, offset_weight=value))


def small_tables(preset: Preset) -> Preset:
    """Reduce the preset's hash tables to 1,024 rows, each shared by many positions."""
    return replace(preset, field=replace(preset.field, log2_entries=10))


EASIEST = "easy"
"""Name of the case that the others are compared with."""

COUNTS = range(1, 9)
"""Numbers of regions."""

VIEWS_ALONE = {
    "easy": "easy",
    "nested": "nested translucent regions",
    "similar-hues": "regions of similar hue",
    "white": "a white region",
    "greys": "a grey and a white region",
    "one-region": "one region",
    "wires": "thin wires",
    "noise": "noisy volume",
    **{f"regions-{n}": f"{n} regions" for n in COUNTS},
}
"""Scenes that are also learned from views alone, and their titles."""

CASES: dict[str, Case] = {
    EASIEST: Case("easy: opaque, two hues", on_unseen_views),
    "saved": Case("before and after saving", before_and_after_saving),
    "larger-views": Case(f"rendered at {LARGER} times the size", from_cameras(larger)),
    "camera-inside": Case("cameras inside of the volume", from_cameras(at_distance(INSIDE, WIDE))),
    "camera-near": Case("cameras inside of the training sphere", from_cameras(at_distance(NEAR))),
    "camera-far": Case("cameras far outside", from_cameras(at_distance(FAR))),
    "style-flat": Case("style: one colour", painted_like(flat)),
    "style-dark": Case("style: dark", painted_like(dark)),
    "style-grey": Case("style: grey", painted_like(grey)),
    "style-tiny": Case("style: 16 x 16 pixels", painted_like(tiny)),
    "style-barely-masked": Case("style: transparent but for 1 %", painted_like(barely_masked)),
    "nested": Case("nested translucent regions", on_unseen_views, "nested"),
    "lambda-0": Case("nested, lambda_delta 0", on_unseen_views, "nested", change=offset_weight(0.0)),
    "lambda-1": Case("nested, lambda_delta 1", on_unseen_views, "nested", change=offset_weight(1.0)),
    "similar-hues": Case("regions of similar hue", on_unseen_views, "similar-hues"),
    "white": Case("a white region", on_unseen_views, "white"),
    "greys": Case("a grey and a white region", on_unseen_views, "greys"),
    "one-region": Case("one region", on_unseen_views, "one-region"),
    "wires": Case("thin wires", on_unseen_views, "wires"),
    "noise": Case("noisy volume", on_unseen_views, "noise"),
    "views-8": Case("8 views", on_unseen_views, views=8),
    "views-16": Case("16 views", on_unseen_views, views=16),
    "views-42": Case("42 views", on_unseen_views, views=42),
    "small-tables": Case("hash tables of 1,024 rows", on_unseen_views, change=small_tables, encoding="hash"),
    "anisotropic": Case("voxels three times as long", on_unseen_views, "anisotropic"),
    "off-centre": Case("1,000 sides off the origin", on_unseen_views, "off-centre"),
    "tiny-spacing": Case("voxels of 1e-9", on_unseen_views, "tiny-spacing"),
    "huge-spacing": Case("voxels of 1e6", on_unseen_views, "huge-spacing"),
    "transparent": Case("transparent everywhere", refusal),
    **{f"regions-{n}": Case(f"{n} regions", on_unseen_views, f"regions-{n}") for n in COUNTS},
    **{
        f"{name}-views": Case(f"{title}, views alone", on_unseen_views, name, views_only=True)
        for name, title in VIEWS_ALONE.items()
    },
    "regions-similar": Case("3 regions, two of similar hue, views alone", on_unseen_views, "regions-similar",
                            views_only=True),
    "regions-corrected": Case("the same, palette corrected by hand", corrected_by_hand, "regions-similar",
                              views_only=True),
}  # fmt: skip
"""Name -> case."""

USUAL = tuple(name for name in CASES if not name.startswith("regions-"))
"""Cases that run by default: all except numbers of regions, whose tables are in docs/measurements/palette.md."""
