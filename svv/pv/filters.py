"""What our filters share: values, progress, errors that are sentences, and results that are kept.

Errors reach the user as one sentence in Output Messages, and never as a crash: a filter that cannot do its work gives
out what it had before, or nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, MutableMapping
from contextlib import contextmanager
from typing import Any, ClassVar, TypeVar

import vtkmodules.vtkRenderingCore  # noqa: F401  (a server hands out transfer functions as what Python knows of them)
from paraview.util.vtkAlgorithm import VTKPythonAlgorithmBase
from vtkmodules.vtkCommonCore import vtkOutputWindow
from vtkmodules.vtkCommonDataModel import vtkDataObject
from vtkmodules.vtkParallelCore import vtkMultiProcessController

from svv.errors import BadInput, Cancelled, Progress
from svv.measure import give_memory_back
from svv.pv.data import forget_scenes, put_views
from svv.pv.steps import Steps

Result = TypeVar("Result")

ORBIT = 181
"""Frames of the orbit around a scene."""

NOT_INSTALLED = (
    "{name} is missing in ParaView's Python, and StyleRF needs it: start ParaView with `svv paraview` (a server with "
    "`svv pvserver`), which brings it along."
)

_forgetters: list[Callable[[Any, str], None]] = []
"""One for each filter that is there. They must not be the filters' alone: Python would collect what is observed yet."""

_working: list[str] = []
"""Name of the filter that is training: ParaView handles events meanwhile, so another one could be asked to begin."""


class Filter(VTKPythonAlgorithmBase):
    """A filter whose class was decorated with :func:`svv.pv.properties.panel`.

    ``values`` holds the value of every property under its name.
    """

    defaults: ClassVar[dict[str, Any]] = {}

    def __init__(self, inputs: int, outputs: int, kind: str) -> None:
        super().__init__(nInputPorts=inputs, nOutputPorts=outputs, outputType=kind)
        self.values = dict(self.defaults)
        self._status = ""
        self._kept: dict[str, tuple[Any, Any]] = {}
        self.steps: Steps[Any] = Steps()
        self.AddObserver("DeleteEvent", _forgetter(self._kept, self.steps.results))

    # --- the pipeline's requests --------------------------------------------------------------------------------------

    def FillInputPortInformation(self, port: int, info: Any) -> int:
        """Take any data: what is none of ours is refused in a sentence, and not in the pipeline's words."""
        info.Set(self.INPUT_REQUIRED_DATA_TYPE(), "vtkDataObject")
        return 1

    def RequestUpdateExtent(self, request: Any, in_info: Any, out_info: Any) -> int:
        """Ask for the whole input: the output's extent is that of an image."""
        for port in in_info:
            info = port.GetInformationObject(0)
            executive = self.GetExecutive()
            if info is not None and info.Has(executive.WHOLE_EXTENT()):
                info.Set(executive.UPDATE_EXTENT(), info.Get(executive.WHOLE_EXTENT()), 6)
            if info is not None and self.first_rank:
                info.Set(executive.UPDATE_PIECE_NUMBER(), 0)
                info.Set(executive.UPDATE_NUMBER_OF_PIECES(), 1)
        return 1

    def RequestData(self, request: Any, in_info: Any, out_info: Any) -> int:
        """Do the work on the first rank; what others would do is the same."""
        if not self.first_rank:
            return 1
        self.SetAbortExecute(0)  # what stopped the last run does not stop this one
        inputs = [vtkDataObject.GetData(port, 0) for port in in_info]
        outputs = [vtkDataObject.GetData(out_info, port) for port in range(self.GetNumberOfOutputPorts())]
        try:
            self._status = self.work(inputs, outputs, out_info) or "Done."
        except Cancelled:
            self.say("Stopped; what was there before stays. Apply again to go on.", error=False)
            self.before(outputs)
        except BadInput as error:
            self.say(str(error))
            self.before(outputs)
        except ImportError as error:
            self.say(NOT_INSTALLED.format(name=error.name or str(error)))
        except MemoryError:
            self.say("There is not enough memory for this; choose fewer or smaller views, or a smaller preset.")
            self.before(outputs)
        self.UpdateProgress(1.0)
        return 1

    def work(self, inputs: list[Any], outputs: list[Any], out_info: Any) -> str | None:
        """Fill the outputs; return a line for the panel.

        Raises:
            BadInput: a sentence for the user.
            Cancelled: the user stopped it.
        """
        raise NotImplementedError

    def before(self, outputs: list[Any]) -> None:
        """Fill the outputs with what there was before the work that failed; by default nothing."""

    # --- what filters do ----------------------------------------------------------------------------------------------

    @property
    def first_rank(self) -> bool:
        """Whether this process is the one that works, of those of a parallel server."""
        controller = vtkMultiProcessController.GetGlobalController()
        return controller is None or controller.GetLocalProcessId() == 0

    def progress(self, fraction: float, label: str) -> None:
        """Show progress in ParaView's bar.

        Raises:
            Cancelled: the user pressed Abort.
        """
        self.SetProgressText(label)
        self.UpdateProgress(min(max(fraction, 0.0), 1.0))
        check = getattr(self, "CheckAbort", None)  # from VTK 9.3 on
        if self.GetAbortExecute() or (check is not None and check()):
            raise Cancelled

    @contextmanager
    def training(self) -> Iterator[Progress]:
        """Give progress to long work, of which only one may run at a time.

        Raises:
            BadInput: another filter is at it.
        """
        if _working:
            raise BadInput(f"{_working[0]} is at work; apply this filter again when it is done, or stop that one.")
        _working.append(type(self).__name__)
        try:
            yield self.progress
        finally:
            _working.clear()
            give_memory_back()

    def kept(self, name: str, key: Any, make: Callable[[], Result]) -> Result:
        """The result of ``make`` under this key, made only if the last one was of another key."""
        if name not in self._kept or self._kept[name][0] != key:
            self._kept[name] = (key, make())
        result: Result = self._kept[name][1]
        return result

    def last(self, name: str) -> Any:
        """The last result that was kept under this name, or None."""
        return self._kept[name][1] if name in self._kept else None

    def forget(self, *names: str) -> None:
        """Make these results anew next time."""
        for name in names:
            self._kept.pop(name, None)
        self.Modified()

    def say(self, sentence: str, error: bool = True) -> None:
        """Tell the user, in Output Messages and in the property Status."""
        self._status = sentence
        window = vtkOutputWindow.GetInstance()
        (window.DisplayErrorText if error else window.DisplayWarningText)(f"{type(self).__name__}: {sentence}\n")

    def GetStatus(self) -> str:
        """What the filter did last, or why it failed."""
        return self._status

    def TakeAsEdited(self) -> None:
        """Look at the transfer function, and at the time step that is shown."""
        self.steps.ask()
        self.Modified()


def _forgetter(*kept: MutableMapping[Any, Any]) -> Callable[[Any, str], None]:
    """What to do when a filter is deleted. VTK may hold on to its Python attributes long after."""

    def forget(_: Any, event: str) -> None:
        for results in kept:
            results.clear()
        _forgetters.remove(forget)
        if not _forgetters:
            forget_scenes()
        give_memory_back()

    _forgetters.append(forget)
    return forget


def set_image_information(filter: Filter, out_info: Any, width: int, height: int, port: int = 0) -> None:
    """Tell the pipeline the size of the image that will come."""
    info = out_info.GetInformationObject(port)
    info.Set(filter.GetExecutive().WHOLE_EXTENT(), (0, width - 1, 0, height - 1, 0, 0), 6)
    info.Set(vtkDataObject.SPACING(), (1.0, 1.0, 1.0), 3)
    info.Set(vtkDataObject.ORIGIN(), (0.0, 0.0, 0.0), 3)


def time_asked_for(filter: Filter) -> float | None:
    """The time for which the first input was asked, None without one."""
    executive = filter.GetExecutive()
    info, key = executive.GetInputInformation(0, 0), executive.UPDATE_TIME_STEP()
    return float(info.Get(key)) if info is not None and info.Has(key) else None


class ViewsOutput(Filter):
    """Gives out one view as an image, that of the property ``ShownView``, and all cameras."""

    last_view = 0
    """Number of the last view that there is, or will be."""

    def FillOutputPortInformation(self, port: int, info: Any) -> int:
        """An image, and points."""
        info.Set(vtkDataObject.DATA_TYPE_NAME(), ("vtkImageData", "vtkPolyData")[port])
        return 1

    def show(self, views: Any, outputs: list[Any], key: str = "") -> None:
        """Give out views; the last one where there are fewer than the panel asks for. ``key``: see ``put_views``."""
        image, cameras = outputs
        put_views(views, min(max(self.values["ShownView"], 0), len(views) - 1), image, cameras, key)

    def GetViewNumbers(self) -> tuple[int, int]:
        """The range of ``ShownView``."""
        return 0, self.last_view


class ImageOutput(Filter):
    """Gives out an image of a scene."""

    def RequestInformation(self, request: Any, in_info: Any, out_info: Any) -> int:
        """The image's size; time steps are those of the input."""
        set_image_information(self, out_info, *(int(v) for v in self.values["ImageSize"]))
        return 1
