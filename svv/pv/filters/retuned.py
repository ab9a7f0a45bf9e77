"""Scenes whose transfer function has been edited since they were trained: other opacities are shown at once.

That takes a scene that knows its volume's values, or the volume (:mod:`svv.job.opacities`). What it cannot show, such
as other colours, stays as it was trained, and the user is told why, or what is only approximate.
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
    from vtkmodules.vtkCommonDataModel import vtkDataObject

    from svv.fields.scene.scene import Scene
    from svv.pv.live.beside import Beside

NOW = " The opacities are those of the transfer function as it has been edited since."
NOT = " The transfer function has been edited since. {why} Take What Is Shown Now trains it again."


def can_be_retuned(scene: Scene | Stored, data: vtkDataObject | None) -> bool:
    """Return whether a scene can show other opacities: it knows its volume's values, or was learned from ``data``."""
    from svv.pv.work.engine import is_whole_volume

    known = scene.follows_time if isinstance(scene, Stored) else None not in (scene.values, scene.steps)
    return known or (scene.made.get("learned_from") == "volume and views" and is_whole_volume(data))


def as_edited_since(
    filter: Beside, scene: Scene | Stored, name: str, present: Moment, followed: str = ""
) -> tuple[Scene | Stored, str]:
    """Return a filter's scene as the transfer function shows it now, and what to say about that, after a space.

    ``followed`` is what is said if the scene shows the present time already, though it was trained at another one.
    """
    made, stale = filter.steps.made, followed or filter.steps.describe_staleness(present)
    filter.shows_edits = can_be_retuned(scene, filter.data)
    if made is None or made.look == present.look or not filter.shows_edits:
        return scene, stale
    if made.data != present.data and not followed:
        return scene, stale
    key = (name, present.look, present.data)
    changed, why = filter.get_or_make("retuned", key, lambda: retuned(scene, filter.values, filter.data))
    if changed is None:
        return scene, followed + NOT.format(why=why)
    if RETUNED not in changed.made:
        return scene, stale
    said = " ".join([followed + NOW, *changed.made.get("approximate", [])])
    if not (isinstance(scene, Stored) and filter.draws):
        return changed, said
    kept = name_of("opacities", digest(name), digest(present.look))
    if not Cache.of_user().holds(kept):
        full = Cache.of_user().write(kept, changed.save)
        if full:
            return scene, NOT.format(why=full)
    return Stored.read(Cache.of_user().folder / kept), said


def retuned(scene: Scene | Stored, values: Values, data: vtkDataObject | None) -> tuple[Scene | None, str]:
    """Return a scene with the opacities of the panel's transfer function; None if it cannot show them, and why."""
    from svv.fields.scene.scene import Scene
    from svv.job.opacities import with_opacities
    from svv.pv.display.shown import volume_shown
    from svv.pv.work.engine import transfer_function_of, volume_of

    whole = Scene.load(scene.path) if isinstance(scene, Stored) else scene
    try:
        volume = None if whole.values is not None else volume_shown(volume_of(data, values), values)
        changed = with_opacities(whole, transfer_function_of(values), volume)
    except BadInput as error:
        return None, str(error)
    if changed is whole:
        return whole, ""
    return replace(changed, made={**changed.made, RETUNED: digest_of_scene(whole)}), ""


def tuned_like(scene: Scene, other: Scene) -> Scene:
    """Return a scene with the opacities of another that was made of the same, or raise BadInput if it cannot."""
    from svv.dvr.functions.transfer_functions import TransferFunction
    from svv.fields.following.other_cells import on_cells
    from svv.job.opacities import with_opacities

    mine, its = (one.made.get("source", {}).get("tf") for one in (scene, other))
    if its is None or mine == its or RETUNED not in {**scene.made, **other.made}:
        return scene
    if scene.values is not None:
        changed = with_opacities(scene, TransferFunction.from_dict(its))
    else:
        assert other.base.density is not None
        changed = on_cells(scene, other.occupancy, other.base.density)
        changed = replace(changed, made={**scene.made, "source": other.made["source"]})
    return replace(changed, made={**changed.made, RETUNED: digest_of_scene(scene)})
