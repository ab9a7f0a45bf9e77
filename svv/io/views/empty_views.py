"""Views that show nothing: nothing can be learned from them."""

from __future__ import annotations

from svv.errors import BadInput
from svv.io.views.viewset import ViewSet

WHY = "check the transfer function (its opacities, and over which values they run) or the pictures' background"


def empty_views(views: ViewSet) -> str | None:
    """Say in one sentence how many views show nothing; None unless more than half of them do."""
    empty = [name for name, shows in zip(views.names, _showing(views), strict=True) if not shows]
    if 2 * len(empty) <= len(views):
        return None
    if len(empty) == len(views):
        how = "of one colour" if views.images[..., 3].any() else "transparent"
        return f"None of the {len(views)} views shows anything: all are {how} throughout; {WHY}."
    some = ", ".join(empty[:3]) + ", ..." * (len(empty) > 3)
    return f"{len(empty)} of {len(views)} views ({some}) show nothing: {WHY}."


def check_shown(views: ViewSet) -> str | None:
    """Return what :func:`empty_views` says; raises BadInput if no view shows anything."""
    said = empty_views(views)
    if said is not None and not any(_showing(views)):
        raise BadInput(said)
    return said


def _showing(views: ViewSet) -> list[bool]:
    """Return which views show something: not all is transparent, nor all views of the same colour throughout."""
    images = views.images
    if all((image == images[0, 0, 0]).all() for image in images):
        return [False] * len(images)
    return [bool(image[..., 3].any()) for image in images]
