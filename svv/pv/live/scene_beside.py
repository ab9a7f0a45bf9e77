"""Filters that learn anew of a scene beside ParaView's window: its palette, and its paintings."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from svv.pv.live.beside import Beside
from svv.pv.live.handed import hand_over_scene
from svv.pv.live.ordered import Ordered
from svv.pv.panel_values import Values
from svv.pv.results.stored import Stored
from svv.pv.vtk_types import Data
from svv.pv.work.cached import SceneOutput
from svv.pv.work.unfinished import mark_unfinished

if TYPE_CHECKING:
    from svv.fields.scene.scene import Scene


class SceneBeside(SceneOutput, Beside):
    """A filter that learns anew of a scene beside the window."""

    headers = False  # paintings of several names are put together here, and regions edited
    nothing = "The scene is shown as it was."
    slots: tuple[str, ...] = ()
    """Beginnings of the names under which it keeps what it has learned in memory."""

    def load_cached(self, name: str, kind: str) -> Scene | None:
        found = super().load_cached(name, kind)
        assert not isinstance(found, Stored)
        return found

    def handed(self, values: Values) -> tuple[Values, Callable[[Path], None]]:
        """Return the values for the process that learns, and what writes the scene to a new folder."""
        data = self.data
        assert data is not None
        return values, lambda folder: hand_over_scene(data, folder)

    def release(self) -> None:
        super().release()
        for slot in [slot for slot in self._kept if slot.startswith(self.slots)]:
            del self._kept[slot]

    def meanwhile(self, inputs: list[Data], outputs: list[Data], learner: Ordered) -> None:
        if not self.put_newest(outputs[0]):
            self.before(outputs)
            if not outputs[0].GetNumberOfRows():
                outputs[0].ShallowCopy(inputs[0])
            mark_unfinished(outputs[0])
