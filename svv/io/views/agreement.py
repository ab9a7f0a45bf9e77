"""Whether pictures contradict their cameras, which train to a blur without an error, and which mistake explains it.

Silhouettes tell (:mod:`svv.core.view_checks.agreement`), and undoing the usual mistakes one by one tells which it was.
Right cameras must never be refused, however noisy, transparent or sparse the pictures are: a set is refused only if
other cameras agree several times better, or if its own agree no better than the same cameras in any order.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from svv.core.geometry.cameras import Camera
from svv.core.view_checks.agreement import MOST_PAIRS, MOST_VIEWS, Outlines, Tracing, some_of
from svv.core.view_checks.camera_mistakes import Mistake, mistakes, turned_by
from svv.core.view_checks.silhouettes import Views, differences, differences_by_view
from svv.errors import BadInput
from svv.io.views.on_screen import fixed_in, noticed, without

Array = NDArray[np.float64]

GOOD = 0.5
"""Pixels by which silhouettes of true cameras differ at most, apart from noise."""

BETTER = 0.3
"""Fraction of the difference that cameras leave which explain the pictures better than those given."""

WORSE = 1.5, 0.3
"""Factor and pixels by which such cameras may be worse at single levels."""

FAR_OFF = 1.0
"""Degrees by which cameras would be turned, from which on silhouettes contradict them; at least 1.5 pixels."""

SMALL = 5.0
"""Pixels of radius below which a silhouette says nothing against cameras: its edge is a few pixels of thin matter."""

NO_BETTER = 0.7
"""Fraction of the difference in any order from which on cameras agree no better than in any order."""

ALONE = 0.2
"""Fraction of the levels that agree, if only as with cameras in any order, up to which others are noise: of a ball,
a level of its empty middle may be all that depends on the order."""

SCREENED = 14, 4, 3, 40
"""Views, levels, tangents (every so many-th) and pairs of views with which every mistake is tried at first."""

KEPT = 12
"""How many of them are tried with all."""

STEPS = 20
"""Most steps in which a turn of all cameras and their angle of view are sought."""

EXPLAINED = 1.0, np.radians(0.6)
"""Pixels, and radians of a turn of the cameras, by which silhouettes may differ once a mistake is undone."""

EQUAL = 0.15
"""Difference of scores below which two explanations are equally good."""

WHOLE_EDGE, MANY = 0.95, 0.3
"""Fraction of the pixels at a picture's edge that the scene fills if its camera is inside, and of such views."""

APART, PAIRS_A_VIEW = (5.0, 2.0), 12
"""Factor of the usual difference and pixels from which a view disagrees with the others, and pairs of each view."""

MOSTLY_CUT = 0.5
"""Fraction of the views whose frames must cut the scene off for a sentence to say that nothing could be compared."""

HARDLY_TELL = (
    "hardly tell whether their cameras are right, because most frames cut the scene off: a few that show it whole "
    "would."
)

SPARSE = 8
"""Every so many-th pixel of a picture that is looked at first to see whether it shows anything."""

NAMED = 5
"""Pictures that a sentence names at most."""

FACED = 0.5
"""Fraction of the cameras that must look towards what they show."""


@dataclass(frozen=True)
class Cause:
    """What is wrong with cameras, and by how many pixels silhouettes differ once it is undone."""

    said: str
    mend: str
    differ: float


@dataclass(frozen=True)
class Agreement:
    """What the pictures of a set say about their cameras, a sentence each; None where there is nothing to say."""

    found: str | None
    """By how many pixels silhouettes differ."""
    doubt: str | None
    """That they differ more than the noise of pictures with true cameras would explain, or are inside the scene."""
    fixed: str | None
    """That something stands still on the screen, which was left out of the comparison."""


def check_agreement(
    cameras: Sequence[Camera],
    images: NDArray[np.uint8],
    names: Sequence[str],
    where: object = None,
    also: Sequence[Mistake] = (),
    drawn: bool = False,
) -> Agreement:
    """Check that pictures (n, height, width, 4) with straight alpha agree with their cameras; BadInput otherwise.

    ``where`` they come from is for messages; the mistakes ``also`` are tried before the usual ones, which are those of
    conversions from other programs: they are looked for in what svv has ``drawn`` only if it disagrees all the same.
    """
    fixed = fixed_in(cameras, images)
    if fixed is not None:  # a colour bar must not be blamed on the cameras
        images = without(images, fixed)
    tracing = Tracing(images)
    outlines = tracing.outlines(some_of(len(cameras)))
    which = "The pictures" if where is None else f"The pictures of {where}"
    found, doubt = _check(cameras, outlines, names, which, also, drawn)
    if found is None and doubt is None and outlines.cut > MOSTLY_CUT:
        doubt = f"{which} {HARDLY_TELL}"
    alone = None if found is None else _apart(cameras, tracing, names)
    doubt = " ".join(filter(None, (doubt, alone, _empty(images, names), _surrounded(images)))) or None
    return Agreement(found, doubt, None if fixed is None else noticed(fixed))


def _apart(cameras: Sequence[Camera], tracing: Tracing, names: Sequence[str]) -> str | None:
    """Name the views whose silhouettes disagree with those of all others, which agree among themselves."""
    count, wrong = len(cameras), []
    step = -(-count // MOST_VIEWS)
    for first in range(step):
        some = np.arange(first, count, step)
        outlines = tracing.outlines(some)
        views = Views.of([cameras[int(k)] for k in some])
        told_by = outlines.of_alpha & ~outlines.inner
        levels = [level for level, tells in zip(outlines.levels, told_by) if tells]
        if not levels:
            return None
        found = np.stack([differences_by_view(views, level, PAIRS_A_VIEW * len(some)) for level in levels])
        told = np.isfinite(found)
        usual = np.array([np.median(row[row_told]) if row_told.any() else np.inf for row, row_told in zip(found, told)])
        far = told & (found > np.maximum(APART[0] * usual, APART[1])[:, None])
        wrong += some[(far.sum(axis=0) > 0.5 * told.sum(axis=0)) & told.any(axis=0)].tolist()
    if not wrong or len(wrong) > MANY * count:
        return None
    return (
        f"{_some(wrong, names)} disagree{'s' * (len(wrong) == 1)} with the silhouettes of all other pictures: check "
        "their cameras, or leave them out."
    )


def _empty(images: NDArray[np.uint8], names: Sequence[str]) -> str | None:
    """Name the pictures that show nothing, if others show something."""
    alpha = images[..., 3]
    empty = [k for k in range(len(images)) if not alpha[k, ::SPARSE, ::SPARSE].any() and not alpha[k].any()]
    if not empty or len(empty) == len(images):
        return None
    return f"{_some(empty, names)} show{'s' * (len(empty) == 1)} nothing: leave out what was not drawn."


def _some(which: Sequence[int], names: Sequence[str]) -> str:
    """Return the names of some pictures, the first few of many."""
    listed = ", ".join(str(names[k]) for k in which[:NAMED])
    more = f" and {len(which) - NAMED} more" if len(which) > NAMED else ""
    return f"The picture{'s' * (len(which) > 1)} {listed}{more}"


def _surrounded(images: NDArray[np.uint8]) -> str | None:
    """Say in how many views the scene fills the edge of the picture, if these are many."""
    alpha = images[..., 3]
    edges = np.concatenate([alpha[:, 0], alpha[:, -1], alpha[:, :, 0], alpha[:, :, -1]], axis=1) > 0
    full = int((edges.mean(axis=1) > WHOLE_EDGE).sum())
    if full < MANY * len(images):
        return None
    return (
        f"In {full} of {len(images)} views, the scene fills the edge of the picture all around: the cameras stand "
        "inside of it or very near (or alpha is inverted), and what lies beyond or behind them is not learned; views "
        "from outside would show it."
    )


def _check(
    cameras: Sequence[Camera],
    outlines: Outlines,
    names: Sequence[str],
    which: str,
    also: Sequence[Mistake],
    drawn: bool,
) -> tuple[str | None, str | None]:
    if not outlines.levels:
        return None, None
    whole = Views.of(cameras)
    own = whole.take(outlines.chosen)
    found, counts = outlines.residuals(own)
    faced = outlines.faced(own) >= FACED
    if faced and not counts.any():
        return None, None
    order = np.random.default_rng(0).permutation(len(cameras))
    mixed, _ = outlines.residuals(replace(whole, matrices=whole.matrices[order]).take(outlines.chosen))
    tells = ~(mixed <= 2.0 * GOOD)  # others, such as those of a ball, agree with anything
    if faced and (found[tells] <= GOOD).sum() >= 0.5 * tells.sum():
        return _agree(found), None
    if drawn and faced:
        with suppress(BadInput):  # an altered folder, whose cause is worth looking for
            judged = _without_cause(outlines, found, mixed, tells, which)
            if judged[1] is None:
                return judged
    cause = _cause(whole, outlines, found, [*also, *mistakes(whole.matrices, names)], cameras[0])
    if cause is not None:
        finite = found[np.isfinite(found)]
        most = f"{finite.max():.3g} pixels" if len(finite) else "more than can be compared"
        raise BadInput(
            f"{which} contradict their cameras: silhouettes differ by {most}, but only by {cause.differ:.2g} if "
            f"{cause.said}; {cause.mend}."
        )
    if not faced:
        raise BadInput(
            f"{which} show what their cameras look away from: transform_matrix must be camera-to-world with x right, y "
            "up and -z forward; if the axes are those of OpenCV, multiply the second and third columns by -1."
        )
    agreed, doubt = _without_cause(outlines, found, mixed, tells, which)
    return agreed, None if drawn else doubt  # what is drawn and has no cause are specks of a noisy volume


def _without_cause(
    outlines: Outlines, found: Array, mixed: Array, tells: NDArray[np.bool_], which: str
) -> tuple[str | None, str | None]:
    """Judge cameras that no usual mistake explains by the same cameras in another order, and by alpha alone.

    In fog, the outline of what is dense along rays may move with the view: a level or two of alpha say nothing against
    cameras with which most agree, and better than in another order.
    """
    of_alpha = np.isfinite(found) & np.isfinite(mixed) & outlines.of_alpha & (outlines.reach >= SMALL)
    tells, agree = tells & of_alpha, of_alpha & (found <= GOOD) & (found <= NO_BETTER * mixed)
    if tells.sum() <= max(agree.sum(), ALONE * (of_alpha & (found <= GOOD)).sum()):
        return _agree(found), None
    far = found > np.maximum(np.radians(FAR_OFF) * outlines.reach, 1.5)
    least = float(found[tells].min())
    if (far & (found > NO_BETTER * mixed))[tells].all():
        turned = np.degrees(least / outlines.reach[tells][found[tells].argmin()])
        raise BadInput(
            f"{which} contradict their cameras: silhouettes differ by {least:.1f} pixels, as if the "
            f"cameras were turned by {turned:.1f} degrees, and hardly more if the cameras are shuffled; check that "
            "each picture has its own camera, and how the cameras were converted."
        )
    if far[tells].all() and outlines.inner[tells].all():
        return None, f"{which} {HARDLY_TELL}"
    if far[tells].all():
        return None, (
            f"{which} may contradict their cameras: silhouettes differ by {least:.1f} pixels or more; if the "
            "scene becomes blurred, check how the cameras were made."
        )
    return _agree(found), None


def _cause(whole: Views, outlines: Outlines, found: Array, usual: Sequence[Mistake], camera: Camera) -> Cause | None:
    """Return the mistake that explains the pictures several times better than the given cameras, if there is one."""
    few = outlines.fewer(*SCREENED[:3])
    tried = []
    for rank, mistake in enumerate(usual):
        views = replace(whole, matrices=mistake.matrices).take(few.chosen)
        tried.append((_score(few.residuals(views, SCREENED[3])[0]), rank, mistake))
    best: tuple[float, Cause] | None = None
    nearest = sorted(tried, key=lambda each: each[:2])[:KEPT]
    for _, _, mistake in sorted(nearest, key=lambda each: each[1]):  # of equally good ones, the likelier
        views = replace(whole, matrices=mistake.matrices).take(outlines.chosen)
        best = _better(best, mistake.said, mistake.mend, views, outlines, found)
    for said, mend, views in _slight(whole.take(outlines.chosen), outlines, camera):
        best = _better(best, said, mend, views, outlines, found)
    return None if best is None else best[1]


def _better(
    best: tuple[float, Cause] | None, said: str, mend: str, views: Views, outlines: Outlines, found: Array
) -> tuple[float, Cause] | None:
    """Return the better explanation of two; the first if they are equally good or the second explains nothing."""
    left, _ = outlines.residuals(views)
    given = np.where(np.isfinite(found), found, np.inf)
    wrong = given > GOOD
    explained = wrong & (left <= BETTER * np.minimum(given, 1e6)) & np.isfinite(left)
    worse = np.isfinite(given) & ~(left <= WORSE[0] * given + WORSE[1])
    if not explained.any() or explained.sum() < 0.5 * wrong.sum() or worse.any() or outlines.faced(views) < FACED:
        return best
    differ, reach = float(np.median(left[explained])), float(np.median(outlines.reach[explained]))
    score = _score(left)
    if differ > max(EXPLAINED[0], EXPLAINED[1] * reach) or (best is not None and score > best[0] - EQUAL):
        return best
    return score, Cause(said, mend, differ)


def _slight(views: Views, outlines: Outlines, camera: Camera) -> list[tuple[str, str, Views]]:
    """Return the same cameras turned by a little, or of another angle of view, as the pictures fit best."""
    few = outlines.fewer(len(outlines.chosen), 3)

    def at(values: Array) -> Views:
        focal = views.focal * np.exp(np.clip(values[3], -2.0, 2.0)) if len(values) > 3 else views.focal
        return replace(views, matrices=turned_by(views.matrices, values[:3]), focal=focal)

    def left(values: Array) -> Array:
        parts = [differences(at(values), silhouettes, MOST_PAIRS, views) for silhouettes in few.levels]
        return np.nan_to_num(np.concatenate(parts), nan=0.0)

    found = []
    for count in (3, 4) if not views.parallel.any() else (3,):
        best = least_squares(left, np.zeros(count), loss="soft_l1", max_nfev=STEPS, x_scale=0.1).x
        found.append(_describe_turn(views, at(best), best[:3], camera))
    if not views.parallel.any():
        best = least_squares(lambda x: left(np.array([0.0, 0.0, 0.0, *x])), np.zeros(1), loss="soft_l1", max_nfev=STEPS)
        found.insert(1, _describe_turn(views, at(np.array([0.0, 0.0, 0.0, *best.x])), np.zeros(3), camera))
    return found


def _describe_turn(given: Views, views: Views, turn: Array, camera: Camera) -> tuple[str, str, Views]:
    causes = []
    degrees = np.degrees(turn)
    if np.abs(degrees).max() > 0.2:
        size = float(np.linalg.norm(degrees))
        axis = ("their x axis (right)", "their y axis (up)", "their line of sight")[int(np.abs(degrees).argmax())]
        causes.append(f"all are turned by {size:.1f} degrees, mostly about {axis}")
    if not given.parallel.any() and abs(np.log(views.focal[0] / given.focal[0])) > 0.01:
        angle, was = (np.degrees(2.0 * np.arctan(0.5 * camera.width / f[0])) for f in (views.focal, given.focal))
        causes.append(f"their horizontal angle of view is {angle:.1f} degrees rather than {was:.1f}")
    return " and ".join(causes) or "they are turned a little", "correct the cameras", views


def _score(found: Array) -> float:
    """Return one number for all levels: the mean of the logarithms, in which each level counts alike."""
    return float(np.mean(np.log(np.minimum(found, 1e3) + 0.1)))


def _agree(found: Array) -> str | None:
    finite = found[np.isfinite(found)]
    return f"The silhouettes agree with the cameras to {finite.min():.2f} pixels." if len(finite) else None
