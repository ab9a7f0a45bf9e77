"""Layers of one scene: the arrays of a volume, each as it was shown when it was added; for a macro and for scripts."""

from __future__ import annotations

from svv.errors import BadInput
from svv.pv.client.capture import shown_as, volume_display
from svv.pv.display.linked_camera import inputs_of
from svv.pv.panel.undo import values_of
from svv.pv.paraview_types import Proxy

TRAIN, JOIN = "StyleRFTrain", "StyleRFJoin"

MOST = 8
"""Maximum number of layers, as of joined scenes (:data:`svv.fields.scene.joined.MOST`)."""


def add_layer(volume: Proxy | None = None) -> Proxy:
    """Add the array by which a volume, by default the active source, is coloured as a layer, with its function.

    Each layer is a StyleRF Train, which is returned before it is applied. From the second one on, StyleRF Join shows
    all as one scene. Another layer is trained with the settings of the one before it. Raises BadInput if the volume is
    not shown, or in a way that is not supported, its array is a layer already, or there are too many. In pvpython::

        add_layer(volume)  # coloured by the array cloud
        ColorBy(GetDisplayProperties(volume), ("POINTS", "rain"))
        add_layer(volume)
        FindSource("StyleRFJoin1")  # cloud and rain
    """
    from paraview import simple

    volume = volume or simple.GetActiveSource()
    if volume is None:
        raise BadInput("Select a volume in the Pipeline Browser first.")
    there = [one for one in _all(TRAIN) if one.Input is not None and one.Input.SMProxy == volume.SMProxy]
    display = volume_display(volume)
    shown, (association, name) = shown_as(display), display.ColorArrayName
    if any(list(one.Scalars) == [association, name] for one in there):
        raise BadInput(
            f"{name} is a layer already: colour the volume by another array. To show it with two transfer "
            "functions, add StyleRF Train and StyleRF Join by hand."
        )
    if len(there) >= MOST:
        raise BadInput(
            f"One scene holds {MOST} layers: show more of them side by side, each as a scene of its own (svv figure)."
        )
    settings = values_of(there[-1].SMProxy) if there else {}
    train = simple.StyleRFTrain(Input=volume)
    for own, value in settings.items():
        if own not in (*shown, "SceneFile"):
            train.GetProperty(own).SetData(value)
    train.SMProxy.UpdateVTKObjects()
    if there:
        _join_with(train, there)
    simple.SetActiveSource(volume)  # for the next one
    return train


def _join_with(train: Proxy, others: list[Proxy]) -> None:
    """Let the filter that joins some of the other layers join one more; if there is none, add it."""
    from paraview import simple

    known = [one.SMProxy for one in others]
    for join in _all(JOIN):
        inputs = inputs_of(join)
        if any(given.SMProxy in known for given in inputs):
            join.Input = [*inputs, train]
            return
    simple.StyleRFJoin(Input=[*others, train])


def _all(kind: str) -> list[Proxy]:
    """Return the filters of a kind, in the order in which they were created."""
    from paraview import simple

    every = sorted(simple.GetSources().items(), key=lambda one: int(one[0][1]))  # by their numbers
    return [source for _, source in every if source.SMProxy.GetXMLName() == kind]
