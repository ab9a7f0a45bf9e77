"""The views of a scene determine whether it needs a lighting network."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from svv.core.colour.shading import Shading
from svv.dvr.draw.views import make_views
from svv.errors import Cancelled
from svv.fields.radiance.rendering import composite, ended, march
from svv.fields.scene.scene import Scene
from svv.io.views.view_meta import ViewMeta
from svv.io.views.viewset import ViewSet
from svv.job.compile_ahead import ball_views
from svv.styles.gallery.textures import style_picture
from svv.train.palette.lighting import LEAST, change_aside, light_by_trial, shows_light
from svv.train.pipeline import stylize_scene, train_scene
from svv.train.run.config import PRESETS, RecolourSettings
from svv.train.run.loop import Running
from tests.cube import cube_scene
from tests.stirred_volume import stirred_transfer_function, stirred_volume

DRAFT = PRESETS["draft"]
SHORT = replace(
    DRAFT,
    reconstruct=replace(DRAFT.reconstruct, iterations=300, rays=1024, samples=8192),
    recolour=replace(DRAFT.recolour, iterations=60, rays=1024, samples=8192),
    stylize=replace(DRAFT.stylize, style_size=64),
)


@pytest.fixture(scope="module", params=[True, pytest.param(False, marks=pytest.mark.slow)], ids=["shaded", "unshaded"])
def trained(request: pytest.FixtureRequest) -> tuple[bool, ViewSet, Scene, str]:
    """Whether the views are shaded, the views, the scene, and what it says of its lighting."""
    tf = stirred_transfer_function()
    tf = replace(tf, opacities=(tf.opacities[0], *tf.opacities[4:]))  # without the translucent shell
    views, _ = make_views(
        stirred_volume(32), tf, n=24, size=96, test=0, mapper="cpu", shading=Shading(on=request.param)
    )
    scene, report = train_scene(views, SHORT, lighting="network")
    (said,) = [note for note in report["notes"] if "lighting network" in note]
    return request.param, views, scene, said


def test_a_lighting_network_where_there_is_light(trained: tuple[bool, ViewSet, Scene, str]) -> None:
    shaded, _, scene, said = trained
    assert scene.palette_network is not None
    assert (scene.settings.lighting == "network") == shaded == (scene.palette_network.lighting_mlp is not None)
    assert said.startswith("the views were drawn with" + (" shading" if shaded else "out shading"))


def test_views_that_do_not_say_are_looked_at(trained: tuple[bool, ViewSet, Scene, str]) -> None:
    _, views, scene, _ = trained
    silent = replace(views, meta=ViewMeta())
    found = shows_light(scene, silent, 0)
    assert found[0] == (change_aside(scene, silent, 0) >= LEAST) and "20 degrees to the side" in found[1]
    none = replace(views, meta=ViewMeta(shading=Shading(ambient=1.0, diffuse=0.0, specular=0.0)))
    assert not shows_light(scene, none, 0)[0]


def test_light_changes_more_than_its_absence(trained: tuple[bool, ViewSet, Scene, str]) -> None:
    shaded, views, scene, _ = trained
    assert (255 * change_aside(scene, views, 0) > 3.0) == shaded


def test_images_without_light_are_the_same_from_torch_and_kernels(trained: tuple[bool, ViewSet, Scene, str]) -> None:
    _, views, scene, _ = trained
    camera = views.cameras[3].resized(48, 48)
    fused = scene.render(camera, "pcn").rgba
    again = Scene.from_arrays(*scene.to_arrays(packed=False))
    assert again.settings == scene.settings
    np.testing.assert_array_equal(again.render(camera, "pcn").rgba, fused)
    rays = scene.caster([camera]).view(0)
    samples = ended(march(rays, scene.occupancy, scene.base.density, scene.marching_for_images))
    colour, _, sigma = scene.shade(samples, rays, "pcn")
    plain = composite(samples, sigma, colour)[0].numpy().reshape(48, 48, 3)
    # Images are clamped to what can be shown.
    np.testing.assert_allclose(np.minimum(plain, fused[..., 3:]), fused[..., :3] * fused[..., 3:], atol=1e-2)


def test_light_can_be_turned_off_where_there_is_some(trained: tuple[bool, ViewSet, Scene, str]) -> None:
    shaded, views, scene, _ = trained
    lit, dark = (s.render(views.cameras[3], "pcn").rgba for s in (scene, scene.edited(0, lighting=0.0)))
    assert (np.abs(dark - lit).max() > 0.05) == shaded


def test_scenes_are_painted_with_and_without_light(trained: tuple[bool, ViewSet, Scene, str]) -> None:
    _, views, scene, _ = trained
    painted, _ = stylize_scene(scene, [style_picture("brush strokes", 64).astype(np.float32)], SHORT)
    before, after = scene.render(views.cameras[3], "pcn").rgba, painted.render(views.cameras[3]).rgba
    np.testing.assert_allclose(after[..., 3], before[..., 3], atol=1e-6)
    assert np.abs(after - before)[..., :3].max() > 0.05


@pytest.mark.parametrize(("few", "steps"), [(7, 100), (6, 250)])
def test_a_trial_on_few_views_is_short(few: int, steps: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Given more steps, the network explains 8 views better than any light, and unseen ones 5 dB worse."""

    def stop(views: ViewSet, scene: Scene, palette: object, settings: RecolourSettings, *_: object) -> None:
        assert settings.iterations == steps
        raise Cancelled

    monkeypatch.setattr("svv.train.palette.lighting.FEW_VIEWS", few)
    monkeypatch.setattr("svv.train.palette.lighting.recolour", stop)
    with pytest.raises(Cancelled):  # six views
        light_by_trial(cube_scene(), ball_views(), np.zeros((1, 3)), RecolourSettings(iterations=1000), Running(0))
