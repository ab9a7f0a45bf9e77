"""Scenes whose transfer function has been edited since they were trained: other opacities are shown at once.

That takes a scene that knows its volume's values (:mod:`svv.job.opacities`). What such a scene cannot show, other
colours and values that were transparent, stays as it was trained, and the user is told why.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from svv.errors import BadInput
from svv.io.files.cache import Cache
from svv.io.files.keyed_results import digest
from svv.pv.panel_values import Values
from svv.pv.results.keys import RETUNED, digest_of_scene, name_of
from svv.pv.results.stored import Stored
from svv.pv.results.time_steps import Moment

if TYPE_CHECKING:
    from svv.fields.scene.scene import Scene
    from svv.pv.live.beside import Beside

NOW = " The opacities are those of the transfer function as it has been edited since."
NOT = " The transfer function has been edited since. {why} Take What Is Shown Now trains it again."


def knows_values(scene: Scene | Stored) -> bool:
    """Return whether a scene is a function of its volume's values, so that it can show other opacities."""
    if isinstance(scene, Stored):
        return scene.follows_time
    return scene.values is not None and scene.steps is not None


def as_edited_since(
    filter: Beside, scene: Scene | Stored, name: str, present: Moment, followed: str = ""
) -> tuple[Scene | Stored, str]:
    """Return a filter's scene as the transfer function shows it now, and what to say about that, after a space.

    Args:
        filter: The filter. What it has to show is kept until the function or the scene changes.
        scene: The scene, as it was trained or painted.
        name: Name under which that is kept.
        present: The present inputs.
        followed: What is said if the scene shows the present time already, though it was trained at another one.
    """
    made, told = filter.steps.made, followed or filter.steps.told(present)
    filter.shows_edits = knows_values(scene)
    if made is None or made.look == present.look or not filter.shows_edits:
        return scene, told
    if made.data != present.data and not followed:
        return scene, told
    key = (name, present.look, present.data)
    changed, why = filter.kept("retuned", key, lambda: retuned(scene, filter.values))
    if changed is None:
        return scene, followed + NOT.format(why=why)
    if not (isinstance(scene, Stored) and filter.draws):
        return changed, followed + NOW
    kept = name_of("opacities", digest(name), digest(present.look))
    if not Cache.of_user().holds(kept):
        said = Cache.of_user().write(kept, changed.save)
        if said:
            return scene, NOT.format(why=said)
    return Stored.read(Cache.of_user().folder / kept), NOW


def retuned(scene: Scene | Stored, values: Values) -> tuple[Scene | None, str]:
    """Return a scene with the opacities of the panel's transfer function; None if it cannot show them, and why."""
    from svv.fields.scene.scene import Scene
    from svv.job.opacities import with_opacities
    from svv.pv.filters.engine import transfer_function_of

    whole = Scene.load(scene.path) if isinstance(scene, Stored) else scene
    try:
        changed = with_opacities(whole, transfer_function_of(values))
    except BadInput as error:
        return None, str(error)
    return replace(changed, made={**changed.made, RETUNED: digest_of_scene(whole)}), ""


def tuned_like(scene: Scene, other: Scene) -> Scene:
    """Return a scene with the opacities of another one that was made of the same.

    Raises:
        BadInput: It cannot show them.
    """
    from svv.dvr.functions.transfer_functions import TransferFunction
    from svv.job.opacities import with_opacities

    mine, its = (one.made.get("source", {}).get("tf") for one in (scene, other))
    if its is None or mine == its or RETUNED not in {**scene.made, **other.made}:
        return scene
    changed = with_opacities(scene, TransferFunction.from_dict(its))
    return replace(changed, made={**changed.made, RETUNED: digest_of_scene(scene)})
