"""Views with the same picture although their cameras differ: usually a mistake in the files."""

from __future__ import annotations

from collections import defaultdict

from svv.io.views.viewset import ViewSet

STRIDE = 16
"""Pixels between those compared first; only views that agree in these are compared as a whole."""


def equal_views(views: ViewSet) -> str | None:
    """Say in one sentence how many views have the picture of another view with a different camera; None if none has.

    A scene that looks the same from several sides, such as a ball, has such views rightly; otherwise, files were
    copied or their cameras are wrong. Empty pictures do not count, because a camera may look past the scene.
    """
    alike: dict[bytes, list[int]] = defaultdict(list)
    for number, image in enumerate(views.images):
        alike[image[::STRIDE, ::STRIDE].tobytes()].append(number)
    found: set[int] = set()
    for numbers in (group for group in alike.values() if len(group) > 1):
        same: dict[bytes, list[int]] = defaultdict(list)
        for number in numbers:
            if views.images[number, ..., 3].any():
                same[views.images[number].tobytes()].append(number)
        for group in same.values():
            matrices = {views.cameras[number].camera_to_world.tobytes() for number in group}
            if len(matrices) > 1:
                found.update(group)
    if not found:
        return None
    some = ", ".join(views.names[number] for number in sorted(found)[:3]) + ", ..." * (len(found) > 3)
    return (
        f"{len(found)} of {len(views)} views ({some}) have exactly the same picture as another view whose camera "
        "differs: unless the scene looks the same from these sides, check files and cameras."
    )
