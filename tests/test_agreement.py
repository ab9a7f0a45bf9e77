"""Pictures that contradict their cameras are told by what was done wrong; right ones are accepted, however noisy."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from vtkmodules.vtkImagingCore import vtkRTAnalyticSource

from svv.core.colour.shading import Shading
from svv.core.geometry.cameras import Camera, sphere_cameras
from svv.core.view_checks.camera_mistakes import mistakes
from svv.dvr.draw.views import make_views
from svv.dvr.functions.transfer_functions import TransferFunction
from svv.dvr.read.grids import as_volume, from_array
from svv.errors import BadInput
from svv.io.views.agreement import Agreement, check_agreement
from svv.io.views.on_screen import ignoring_fixed
from svv.io.views.viewset import ViewSet
from svv.train.pipeline import train_scene
from tests.cinema_database import BALLS, picture
from tests.nightly import nightly

Matrices = NDArray[np.float64]
CAMERAS = sphere_cameras(24, (0.0, 0.0, 0.0), 6.0, float(np.radians(30.0)), 96)
MATRICES = np.stack([camera.camera_to_world for camera in CAMERAS])
IMAGES = np.stack([picture(camera) for camera in CAMERAS])
NAMES = [f"r_{k}" for k in range(len(CAMERAS))]
OPENCV = np.diag((1.0, -1.0, -1.0, 1.0))
Y_UP = np.array(((1.0, 0, 0), (0, 0, 1), (0, -1, 0)))


def with_matrices(matrices: Matrices) -> list[Camera]:
    return [replace(camera, camera_to_world=matrix) for camera, matrix in zip(CAMERAS, matrices, strict=True)]


def joined(rotation: Matrices, position: Matrices) -> Matrices:
    found = MATRICES.copy()
    found[:, :3, :3], found[:, :3, 3] = rotation, position
    return found


def turned(axis: int, degrees: float) -> Matrices:
    turn = np.eye(4)
    turn[:3, :3] = Rotation.from_rotvec(np.radians(degrees) * np.eye(3)[axis]).as_matrix()
    return MATRICES @ turn


def check(cameras: list[Camera] | None = None, images: NDArray[np.uint8] = IMAGES) -> Agreement:
    return check_agreement(cameras or list(CAMERAS), images, NAMES)


R, T = MATRICES[:, :3, :3], MATRICES[:, :3, 3]
WRONG = {
    "world-to-camera": (np.linalg.inv(MATRICES), "world-to-camera; invert each"),
    "OpenCV": (MATRICES @ OPENCV, "OpenCV and COLMAP .* multiply their second and third columns by -1"),
    "COLMAP": (OPENCV @ np.linalg.inv(MATRICES), "world-to-camera and the camera axes are those of OpenCV"),
    "transposed": (joined(R.transpose(0, 2, 1), T), "the rotations are transposed"),
    "next frame": (np.roll(MATRICES, -1, axis=0), "belongs to the camera 1 frame earlier"),
    "names as text": (MATRICES[np.argsort(sorted(range(24), key=lambda k: NAMES[k]))], "order of their names as text"),
    "turned pictures": (turned(2, 90.0), "turned by 90 degrees .* EXIF"),
    "turned a little": (turned(2, 12.0), r"turned by 1[12]\.\d degrees, mostly about their line of sight"),
    "other world": (joined(Y_UP @ R, T), "a world with other axes than that of the positions"),
    "quaternions": (joined(Rotation.from_quat(np.roll(Rotation.from_matrix(R).as_quat(), 1, 1)).as_matrix(), T),
                    "come from quaternions"),
}  # fmt: skip


@pytest.mark.parametrize("case", nightly(WRONG, "COLMAP", "names as text", "turned a little", "quaternions"))
def test_the_mistake_is_named(case: str) -> None:
    matrices, says = WRONG[case]
    with pytest.raises(BadInput, match=says) as caught:
        check(with_matrices(matrices))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda images: images[:, :, ::-1], "mirrored left to right"),
        pytest.param(lambda images: np.rot90(images, 1, (1, 2)), "turn the pictures clockwise", marks=pytest.mark.slow),
        (lambda images: np.rot90(images, -1, (1, 2)), "turn the pictures counter-clockwise"),
    ],
)
def test_pictures_that_are_turned_or_mirrored(change: Callable[..., NDArray[np.uint8]], says: str) -> None:
    with pytest.raises(BadInput, match=says):
        check(images=np.ascontiguousarray(change(IMAGES)))


def test_cameras_in_any_order_are_refused_without_a_cause() -> None:
    with pytest.raises(BadInput, match="hardly more if the cameras are shuffled"):
        check(with_matrices(MATRICES[np.random.default_rng(3).permutation(24)]))


def test_undoing_a_mistake_gives_the_cameras_back() -> None:
    """Of those that the mistakes would yield, one is the truth, up to the world's axes."""
    for case in ("world-to-camera", "OpenCV", "COLMAP", "transposed", "next frame", "names as text", "quaternions"):
        found = (mistake.matrices for mistake in mistakes(np.ascontiguousarray(WRONG[case][0]), NAMES))
        assert any(np.allclose(matrices, MATRICES, atol=1e-9) for matrices in found), case


def dusty(images: NDArray[np.uint8], rng: np.random.Generator) -> NDArray[np.uint8]:
    images[rng.random(images.shape[:3]) < 0.003] = 255
    return images


def grainy(images: NDArray[np.uint8], rng: np.random.Generator) -> NDArray[np.uint8]:
    noise = images[..., 3] + rng.normal(0.0, 30.0, images.shape[:3])
    images[..., 3] = np.where(images[..., 3] > 0, np.clip(noise, 1, 255), 0)
    return images


def faint(images: NDArray[np.uint8], rng: np.random.Generator) -> NDArray[np.uint8]:
    images[..., 3] //= 30
    return images


def unequal(images: NDArray[np.uint8], rng: np.random.Generator) -> NDArray[np.uint8]:
    images[..., 3] = images[..., 3] * rng.uniform(0.3, 1.0, (len(images), 1, 1))
    return images


def cut_off(images: NDArray[np.uint8], rng: np.random.Generator) -> NDArray[np.uint8]:
    images[:, :, :40] = 0
    return images


RIGHT = {"as they are": lambda images, rng: images, "dust": dusty, "grain": grainy, "faint": faint,
         "other exposure": unequal, "cut off": cut_off, "nothing": lambda images, rng: 0 * images}  # fmt: skip


@pytest.mark.parametrize("case", RIGHT)
def test_right_cameras_are_never_refused(case: str) -> None:
    found = check(images=RIGHT[case](IMAGES.copy(), np.random.default_rng(0)))
    assert found.fixed is None
    if case in ("as they are", "faint"):
        assert found.doubt is None and found.found is not None and found.found.startswith("The silhouettes agree")


def test_specks_of_a_noisy_volume_do_not_contradict_cameras_that_drew_it() -> None:
    """Of other pictures, as many specks would be doubtful."""
    z, y, x = (np.indices((64, 64, 64)) + 0.5) / 64 - 0.5
    noise = 0.25 * np.random.default_rng(0).standard_normal((64, 64, 64))
    values = np.clip(np.where(np.sqrt(x * x + y * y + z * z) < 0.45, 0.8, 0.0) + noise, 0.0, 1.0)
    opacities = tuple((v, 1.0 - np.exp(-s), 0.5, 0.0) for v, s in ((0.5, 0.0), (0.6, 0.3), (0.8, 1.0), (1.0, 3.0)))
    colours = ((0.5, 0.1, 0.2, 0.9), (0.8, 1.0, 0.6, 0.1), (1.0, 0.1, 0.7, 0.2))
    volume = from_array(values.astype(np.float32), (1.0,) * 3, (0.0,) * 3)
    views, _ = make_views(volume, TransferFunction(colours, opacities, 1.0), n=40, size=160, rescale=False)
    doubts = [check_agreement(views.cameras, views.images, views.names, drawn=d).doubt for d in (False, True)]
    assert doubts[0] is not None and "may contradict" in doubts[0]
    assert doubts[1] is None


@pytest.mark.parametrize("size", [0.02, 0.05])
def test_a_few_points_are_enough_to_agree(size: float) -> None:
    points = np.random.default_rng(1).normal(size=(3, 3)) * 0.6
    balls = tuple((*point, size) for point in points)
    assert check(images=np.stack([picture(camera, balls) for camera in CAMERAS])).doubt is None


def test_a_ball_agrees_with_any_cameras_that_look_at_it() -> None:
    ball = np.stack([picture(camera, ((0.0, 0.0, 0.0, 1.0),)) for camera in CAMERAS])
    assert check(with_matrices(np.roll(MATRICES, -1, axis=0)), ball).doubt is None
    with pytest.raises(BadInput, match=r"look away from: .* OpenCV"):
        check(with_matrices(MATRICES @ OPENCV), ball)


@pytest.mark.parametrize(
    ("views", "size"), [(8, 64), *(pytest.param(*other, marks=pytest.mark.slow) for other in ((12, 96), (16, 48)))]
)
def test_a_light_on_the_camera_does_not_contradict_it(views: int, size: int) -> None:
    """What is brightest moves over the surface with the light, and its outline with it; alpha stays."""
    source = vtkRTAnalyticSource()
    source.SetWholeExtent(-12, 12, -12, 12, -12, 12)
    source.Update()
    colours = [(37.4, 0.23, 0.3, 0.75), (157.0, 0.87, 0.87, 0.87), (276.8, 0.7, 0.016, 0.15)]
    opacities = [(37.0, 0.0, 0.5, 0.0), (200.0, 0.0, 0.5, 0.0), (220.0, 1.0, 0.5, 0.0), (277.0, 1.0, 0.5, 0.0)]
    volume, tf = as_volume(source.GetOutput(), None, "wavelet"), TransferFunction(colours, opacities, 2.5)
    lit = Shading(on=True, ambient=0.0, diffuse=1.0, specular=0.0, specular_power=10.0)
    training, _ = make_views(volume, tf, n=views, size=size, mapper="cpu", shading=lit)
    assert check_agreement(training.cameras, training.images, training.names).doubt is None


def test_cameras_inside_are_mentioned() -> None:
    full = IMAGES.copy()
    full[..., 3] = np.maximum(full[..., 3], 9)
    found = check(images=full)
    assert found.doubt is not None and "24 of 24 views, the scene fills the edge" in found.doubt


def test_training_refuses_before_it_begins() -> None:
    views = ViewSet(tuple(with_matrices(np.linalg.inv(MATRICES))), IMAGES, tuple(NAMES))
    with pytest.raises(BadInput, match="contradict their cameras"):
        train_scene(views, "draft")


# --- what stands still on the screen ---------------------------------------------------------------------------------


def with_bar(first: int = 92, top: int = 20) -> NDArray[np.uint8]:
    """Pictures with a colour bar of 50 rows and three columns."""
    images = IMAGES.copy()
    images[:, top : top + 50, first : first + 3] = np.linspace(60, 250, 50)[:, None, None].astype(np.uint8)
    images[:, top : top + 50, first : first + 3, 3] = 255
    return images


def test_a_colour_bar_is_named_and_not_blamed_on_the_cameras() -> None:
    found = check(images=with_bar())
    assert found.doubt is None and found.fixed is not None and "at the right stands still" in found.fixed
    assert found.found is not None and found.found.startswith("The silhouettes agree")
    with pytest.raises(BadInput, match="world-to-camera"):
        check(with_matrices(np.linalg.inv(MATRICES)), with_bar())


def test_axes_that_turn_in_their_corner_are_noticed() -> None:
    images = np.stack([picture(camera, tuple(0.6 * np.array(BALLS))) for camera in CAMERAS])
    for k, image in enumerate(images):
        towards = np.round(4 * np.array((np.sin(k), np.cos(k)))).astype(int)
        for step in np.linspace(0, 1, 9):
            row, column = np.array((88, 7)) + np.round(step * towards).astype(int)
            image[row : row + 2, column : column + 2] = (250, 40, 40, 255)
    found = check(images=images)
    assert found.fixed is not None and "at the lower left" in found.fixed and found.doubt is None


def test_it_is_left_out_on_request() -> None:
    views = ViewSet(tuple(CAMERAS), with_bar(), tuple(NAMES))
    left, said = ignoring_fixed(views)
    assert "at the right" in said and check(list(left.cameras), left.images).fixed is None
    kept = np.stack([IMAGES[NAMES.index(name)] for name in left.names])
    assert np.array_equal(left.images[:, :, :84], kept[:, :, :84]) and not left.images[:, 20:70, 92:95].any()
    same, said = ignoring_fixed(ViewSet(tuple(CAMERAS), IMAGES, tuple(NAMES)))
    assert np.array_equal(same.images, IMAGES) and "changes nothing" in said


def test_views_that_reach_it_are_left_out_or_refused() -> None:
    columns: np.ndarray = np.any(IMAGES[..., 3] > 0, axis=1)
    rightmost = np.array([np.flatnonzero(own).max() for own in columns])
    at = int(np.sort(rightmost)[-5])
    views = ViewSet(tuple(CAMERAS), with_bar(at, 5), tuple(NAMES))
    left, said = ignoring_fixed(views)
    assert len(left) < 24 and f"so are {24 - len(left)} of 24 views" in said


def test_views_of_a_ball_are_taken_though_one_level_is_noise() -> None:
    """The other levels agree with the cameras in any order, so nothing contradicts the given one."""
    ball = np.linalg.norm(np.indices((26, 26, 26)) - 12.5, axis=0).astype(np.float32)
    function = TransferFunction.from_dict({"bumps": [{"centre": 8, "width": 6, "opacity": 0.5}]})
    views, _ = make_views(from_array(ball, (2.0,) * 3, (0.0,) * 3), function, n=12, size=200, mapper="cpu")
    found = check_agreement(views.cameras, views.images, views.names)
    assert found.found is not None and found.doubt is None


@pytest.mark.parametrize("count", [1, 2, 4])
def test_single_pictures_with_wrong_cameras_are_named(count: int) -> None:
    """Most pairs of views agree, so that the whole set does not contradict its cameras."""
    wrong = [3, 11, 14, 20][:count]
    matrices = MATRICES.copy()
    matrices[wrong] = MATRICES[[k + 2 for k in wrong]]
    doubt = check(with_matrices(matrices)).doubt
    assert doubt is not None and "disagree" in doubt
    named = {name for name in NAMES if f" {name}," in doubt or f" {name} " in doubt}
    assert named and named <= {NAMES[k] for k in wrong}  # others are hardly wrong: their silhouettes fit


def test_cameras_in_two_units_are_told() -> None:
    matrices = MATRICES.copy()
    matrices[16:, :3, 3] *= 2.0
    doubt = check(with_matrices(matrices)).doubt
    assert doubt is not None and "disagree" in doubt


def test_pictures_that_show_nothing_are_named() -> None:
    images = IMAGES.copy()
    images[[5, 9]] = 0
    assert (check(images=images).doubt or "").startswith("The pictures r_5, r_9 show nothing")
    assert check(images=images * 0).doubt is None  # training says so


def fog(camera: Camera, balls: tuple[tuple[tuple[float, float, float], float, float], ...]) -> NDArray[np.uint8]:
    """Balls of fog, white, by the lengths of rays within them: centre, radius and extinction of each."""
    origins, directions = camera.rays()
    depth = np.zeros(directions.shape[:2])
    for centre, radius, extinction in balls:
        apart = np.linalg.norm(np.cross(np.array(centre) - origins, directions), axis=-1)
        depth += 2.0 * extinction * np.sqrt(np.maximum(radius**2 - apart**2, 0.0))
    alpha = np.rint(255.0 * (1.0 - np.exp(-depth))).astype(np.uint8)
    return np.dstack([np.full((*alpha.shape, 3), 255, np.uint8), alpha])


FOG = (((-0.3, 0.0, 0.0), 0.6, 3.0), ((0.55, 0.3, 0.3), 0.35, 6.0))


@pytest.mark.parametrize("fovs", [(0.73, 0.55, 0.43), (0.45, 0.4, 0.38)])
def test_views_that_cut_fog_off_are_neither_confirmed_nor_denied(fovs: tuple[float, ...]) -> None:
    """What is dense along the rays of a view that cuts its outline off says nothing against it, or against the set."""
    cameras = [
        replace(camera, fov_x=fovs[k % 3]) for k, camera in enumerate(sphere_cameras(24, (0.0, 0.0, 0.0), 3.2, 0.5, 80))
    ]
    images = np.stack([fog(camera, FOG) for camera in cameras])
    said = check(cameras, images)
    if fovs[0] > 0.7:  # some are whole
        assert said.found is not None and said.doubt is None
        wrong = [*cameras[:9], cameras[12], *cameras[10:]]
        assert "The picture r_9 disagrees" in str(check(wrong, images).doubt)
    else:
        assert "may contradict" not in str(said.doubt) and "disagree" not in str(said.doubt)
        assert said.found is not None or "hardly tell whether their cameras are right" in str(said.doubt)
