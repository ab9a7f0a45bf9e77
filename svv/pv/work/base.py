"""Base classes of the StyleRF filters: property values, progress, error messages, and kept results.

Errors reach the user as a sentence in Output Messages; a filter that fails outputs its previous result, or nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar

import vtkmodules.vtkRenderingCore  # noqa: F401  (lets Python know the class of the server's transfer functions)
from paraview.util.vtkAlgorithm import VTKPythonAlgorithmBase
from vtkmodules.vtkCommonCore import vtkOutputWindow
from vtkmodules.vtkCommonDataModel import vtkDataObject
from vtkmodules.vtkParallelCore import vtkMultiProcessController

from svv.errors import BadInput, Cancelled, Progress, silent
from svv.measure import give_memory_back
from svv.progress import shown
from svv.pv import failed
from svv.pv.connection import client_gone
from svv.pv.panel_sentences import say_in_panel
from svv.pv.panel_values import Values, by_name, label_of
from svv.pv.results.time_steps import Steps
from svv.pv.vtk_types import Data, InInfo, OutInfo, Request
from svv.pv.work.shown_scene import KEY, mark_scene
from svv.pv.work.unfinished import NotYetThere, is_unfinished, mark_unfinished
from svv.pv.work.vtk_data import forget_scenes, put_views

if TYPE_CHECKING:
    from svv.io.views.viewset import ViewSet
    from svv.render.baking.voxels import Grid

Result = TypeVar("Result")
Kept = dict[str, tuple[object, Any]]
"""Results by name, each with the key of what it was made from."""

ORBIT = 181
"""Frames of the orbit around a scene."""

STOPPED = "Stopped; the previous result is kept. Press Apply again to resume."
STOPPED_SCRIPT = "Stopped; the previous result is kept. Update the filter again to resume."

UNFINISHED = "The scene before this filter is still being learned."

WHOLE = ("vtkTable", "vtkImageData", "vtkPolyData")
"""Types of the outputs of StyleRF filters."""

_forgetters: list[Callable[[object, str], None]] = []
"""Deletion observers, one per existing filter; if only the filters held them, Python would collect them too early."""

_working: list[str] = []
"""Name of the filter that is training, if any; ParaView handles events meanwhile, so a second one could be started."""


class Filter(VTKPythonAlgorithmBase):
    """Base class of filters whose class is decorated with :func:`svv.pv.panel.properties.panel`."""

    defaults: ClassVar[Values] = {}

    ports: ClassVar[tuple[int, int, str]] = (1, 1, "vtkTable")
    """Numbers of inputs and outputs, and the type of these."""

    def __init__(self) -> None:
        inputs, outputs, kind = self.ports
        super().__init__(nInputPorts=inputs, nOutputPorts=outputs, outputType=kind)
        self.values = self.defaults.copy()
        self._status = ""
        self._failed_on: object = None
        self._ends = ExitStack()
        self._tell: Progress = silent
        self.unfinished = False
        """Whether the input is made from a scene that is still being learned."""
        self.shows_edits = False
        """Whether an edit of the transfer function changes what it shows without any work being asked for."""
        self._kept: Kept = {}
        self.steps: Steps[Any] = Steps()
        self.AddObserver("DeleteEvent", _forgetter(self._kept, self.steps))

    @property
    def times(self) -> tuple[float, ...]:
        """The times that the first input has; empty if it has none."""
        executive = self.GetExecutive()
        info, key = executive.GetInputInformation(0, 0), executive.TIME_STEPS()
        return tuple(info.Get(key)) if info is not None and info.Has(key) else ()

    # --- the pipeline's requests --------------------------------------------------------------------------------------

    def ProcessRequest(self, request: Request, in_info: InInfo, out_info: OutInfo) -> int:
        """Answer a request of the pipeline; an error in it is said, for it would not get past VTK."""
        try:
            return int(super().ProcessRequest(request, in_info, out_info))
        except Exception as error:
            self.say(failed.sentence_on(error))
            return 1

    def FillInputPortInformation(self, port: int, info: Request) -> int:
        """Accept any data, so that the filter itself can explain which input it needs."""
        info.Set(self.INPUT_REQUIRED_DATA_TYPE(), "vtkDataObject")
        return 1

    def RequestUpdateExtent(self, request: Request, in_info: InInfo, out_info: OutInfo) -> int:
        """Request the whole input, because the output's extent is that of an image and unrelated to the input's.

        All ranks do, or those that draw a volume together would wait for each other in vain. Only the first rank's
        scenes and images are not empty.
        """
        executive = self.GetExecutive()
        connected = [
            (n, k, port) for n, port in enumerate(in_info) for k in range(port.GetNumberOfInformationObjects())
        ]
        for number, connection, port in connected:
            info = port.GetInformationObject(connection)
            if info.Has(executive.WHOLE_EXTENT()):
                info.Set(executive.UPDATE_EXTENT(), info.Get(executive.WHOLE_EXTENT()), 6)
            data = self.GetInputDataObject(number, connection)
            if self.first_rank or (data is not None and any(map(data.IsA, WHOLE))):
                info.Set(executive.UPDATE_PIECE_NUMBER(), 0)
                info.Set(executive.UPDATE_NUMBER_OF_PIECES(), 1)
        return 1

    def RequestData(self, request: Request, in_info: InInfo, out_info: OutInfo) -> int:
        """Do the work on the first rank only; the other ranks would do the same work."""
        if not self.first_rank:
            return 1
        self.SetAbortExecute(0)  # an abort of the last run must not stop this one
        inputs = [vtkDataObject.GetData(port, 0) for port in in_info]
        outputs = [vtkDataObject.GetData(out_info, port) for port in range(self.GetNumberOfOutputPorts())]
        try:
            with ExitStack() as self._ends:
                said = self.work(inputs, outputs, out_info) or "Done."
            self.unfinished = any(map(is_unfinished, inputs))
            for output in outputs if self.unfinished else ():
                mark_unfinished(output)
            earlier = self._made_of_earlier(outputs, len(inputs))
            more = [self.values.get("Notice"), UNFINISHED * self.unfinished, earlier]
            self._status = " ".join(filter(None, [said, *more]))
            self._failed_on = None
        except NotYetThere as reason:
            self._status = str(reason)
            self.before(outputs)
            for output in outputs:
                mark_unfinished(output)
        except Cancelled:
            sentence = STOPPED_SCRIPT if failed.in_script() else STOPPED
            self.say(sentence, error=False)
            self._output_previous(outputs, failed.reason_of(type(self).__name__, sentence, stopped=True))
        except failed.FailedBefore as error:
            self._say_once(str(error), inputs)
            self._output_previous(outputs, str(error))
            failed.note_wrong(self, str(error))
        except Exception as error:
            sentence = failed.sentence_on(error)
            self._say_once(sentence, inputs)
            self._output_previous(outputs, failed.reason_of(type(self).__name__, sentence))
        for output in outputs:
            if output.IsA("vtkTable") and not output.GetFieldData().HasArray(KEY):  # a scene, or there will be one
                mark_scene(output)
        self.UpdateProgress(1.0)
        return 1

    def _output_previous(self, outputs: list[Data], reason: str) -> None:
        """Output the previous result, or nothing, with the reason why it is not the present one."""
        for output in outputs:
            output.GetFieldData().Initialize()  # VTK has passed on that of the input: a whole scene
        self.before(outputs)
        for output in outputs:
            failed.mark_failed(output, reason)

    def _made_of_earlier(self, outputs: list[Data], ports: int) -> str:
        """Mark outputs that are made of an earlier result of a filter that has failed since; return what is said."""
        given = [
            self.GetInputDataObject(port, number)
            for port in range(ports)
            for number in range(self.GetNumberOfInputConnections(port))
        ]
        reason = next(filter(None, (failed.reason_in(data) for data in given if not failed.is_empty(data))), "")
        if not reason:
            failed.note_right(self)
            return ""
        for output in outputs:
            failed.mark_failed(output, reason)
        failed.note_wrong(self, reason)
        return failed.EARLIER.format(reason=reason)

    def work(self, inputs: list[Data], outputs: list[Data], out_info: OutInfo) -> str | None:
        """Fill the outputs; return a line for the panel. Raises BadInput, a sentence for the user, or Cancelled."""
        raise NotImplementedError

    def before(self, outputs: list[Data]) -> None:
        """Fill the outputs with the previous result after the work has failed; by default do nothing."""

    # --- for subclasses -----------------------------------------------------------------------------------------------

    @property
    def first_rank(self) -> bool:
        """Whether this process is the one of a parallel server's processes that does the work."""
        controller = vtkMultiProcessController.GetGlobalController()
        return controller is None or controller.GetLocalProcessId() == 0

    def progress(self, fraction: float, label: str) -> None:
        """Show progress in ParaView's progress bar; raise Cancelled after Abort, or if a server's client has gone."""
        if client_gone():
            raise Cancelled
        self._tell(fraction, label)
        self.SetProgressText(label)
        self.UpdateProgress(min(max(fraction, 0.0), 1.0))
        check = getattr(self, "CheckAbort", None)  # from VTK 9.3 on
        if self.GetAbortExecute() or (check is not None and check()):
            raise Cancelled

    @contextmanager
    def training(self) -> Iterator[Progress]:
        """Provide the progress callback for long work, or raise BadInput if another filter is doing some.

        Scripts show the progress on standard error; it stays there until the filter's work ends.
        """
        if _working:
            raise BadInput(f"{_working[0]} is at work: stop it, or apply this filter again when it is done.")
        _working.append(type(self).__name__)
        if self._tell is silent and failed.in_script():
            self._tell = self._ends.enter_context(shown(failed.name_of(type(self).__name__)))
            self._ends.callback(setattr, self, "_tell", silent)
        try:
            yield self.progress
        finally:
            _working.clear()
            give_memory_back()

    def get_or_make(self, name: str, key: object, make: Callable[[], Result]) -> Result:
        """Return the result kept under a name, and call ``make`` only if the key differs from the last one's."""
        if name not in self._kept or self._kept[name][0] != key:
            self._kept[name] = (key, make())
        result: Result = self._kept[name][1]
        return result

    def last(self, name: str) -> Any:
        """Return the last result that was kept under this name, or None."""
        return self._kept[name][1] if name in self._kept else None

    def forget(self, *names: str) -> None:
        """Forget these results, so that they are made again next time."""
        for name in names:
            self._kept.pop(name, None)
        self.Modified()

    def save(self, result: str, file: str, write: Callable[[Path], object]) -> None:
        """Write something that is kept as ``result`` to the file of a property, for a button, and report it."""
        name = str(by_name(self.values)[file])
        if self.last(result) is None or not name:
            self.say(f"There is nothing to save yet: choose a file under {label_of(file)}, and press Apply.")
            return
        try:
            write(Path(name))
        except (BadInput, Cancelled) as error:
            self.say(str(error) or "Stopped.")
        else:
            self._status = f"Saved as {name}."

    def say(self, sentence: str, error: bool = True) -> None:
        """Report a sentence to the user, in Output Messages and in the property Status."""
        self._status = sentence = say_in_panel(sentence)
        failed.note_failed(self, sentence, stopped=not error)
        if failed.is_strict():
            return  # an exception will say it
        window = vtkOutputWindow.GetInstance()
        (window.DisplayErrorText if error else window.DisplayWarningText)(f"{type(self).__name__}: {sentence}\n")

    def _say_once(self, sentence: str, inputs: list[Data]) -> None:
        """Report why the work failed, but not again if VTK asks for another output of the same inputs and panel."""
        now = sentence, self.GetMTime(), [data and data.GetMTime() for data in inputs]
        self._status = sentence
        if now != self._failed_on:
            self.say(sentence)
        self._failed_on = now

    def GetStatus(self) -> str:
        """Return what the filter did last, or why it failed."""
        return say_in_panel(self._status)

    def TakeAsEdited(self) -> None:
        """Update the result to the current transfer function and time step."""
        self.steps.ask()
        self.Modified()


def _forgetter(kept: Kept, steps: Steps[Any]) -> Callable[[object, str], None]:
    """Return an observer that clears a deleted filter's results, and gives memory back; VTK may keep its attributes."""

    def forget(_: object, event: str) -> None:
        large = bool(steps.results)
        kept.clear()
        steps.results.clear()
        _forgetters.remove(forget)
        if not _forgetters:
            forget_scenes()
        if large or not _forgetters:  # it takes a fifth of a second in a process as large as ParaView's
            give_memory_back()

    _forgetters.append(forget)
    return forget


def set_image_information(filter: Filter, out_info: OutInfo, width: int, height: int, port: int = 0) -> None:
    """Announce the size of the output image to the pipeline.

    It is empty on all ranks but the first: otherwise, those would be executed at every update, without the first.
    """
    info = out_info.GetInformationObject(port)
    extent = (0, width - 1, 0, height - 1, 0, 0) if filter.first_rank else (0, -1, 0, -1, 0, -1)
    info.Set(filter.GetExecutive().WHOLE_EXTENT(), extent, 6)
    info.Set(vtkDataObject.SPACING(), (1.0, 1.0, 1.0), 3)
    info.Set(vtkDataObject.ORIGIN(), (0.0, 0.0, 0.0), 3)


def time_asked_for(filter: Filter) -> float | None:
    """Return the time that was requested of the first input; None if there was none."""
    executive = filter.GetExecutive()
    info, key = executive.GetInputInformation(0, 0), executive.UPDATE_TIME_STEP()
    return float(info.Get(key)) if info is not None and info.Has(key) else None


class ViewsOutput(Filter):
    """A filter whose outputs are one view as an image (property ``ShownView``), and all cameras as points."""

    last_view = 0
    """Number of the last view that exists or will exist."""

    def FillOutputPortInformation(self, port: int, info: Request) -> int:
        """Declare the outputs: an image, and points."""
        info.Set(vtkDataObject.DATA_TYPE_NAME(), ("vtkImageData", "vtkPolyData")[port])
        return 1

    def show(self, views: ViewSet, outputs: list[Data], key: str = "", file: str = "") -> None:
        """Output views; show the last one if the panel asks for a later one. The others are as for ``put_views``."""
        image, cameras = outputs
        put_views(views, min(max(self.values["ShownView"], 0), len(views) - 1), image, cameras, key, file)

    def GetViewNumbers(self) -> tuple[int, int]:
        """Return the range of ``ShownView``."""
        return 0, self.last_view


class ImageOutput(Filter):
    """A filter whose output is an image of a scene."""

    framed = ""
    """What :meth:`GetSeenFrom` returns."""

    def GetSeenFrom(self) -> str:
        """Return position, focal point, view up and horizontal angle of the last camera; empty beside the volume."""
        return self.framed

    def RequestInformation(self, request: Request, in_info: InInfo, out_info: OutInfo) -> int:
        """Announce the image's size; the time steps are those of the input."""
        set_image_information(self, out_info, *(int(v) for v in self.values["ImageSize"]))
        return 1


class VolumeOutput(Filter):
    """A filter whose output is a regular grid of points that depends on the input's scene."""

    def grid_for(self, data: Data | None) -> Grid:
        """Return the grid of the output for a scene's table; raises BadInput if there is none."""
        raise NotImplementedError

    def RequestInformation(self, request: Request, in_info: InInfo, out_info: OutInfo) -> int:
        """Announce the grid of the input's scene, which is updated first: filters behind need to know it before."""
        connection = self.GetInputConnection(0, 0)
        connection.GetProducer().Update(connection.GetIndex())
        try:
            grid = self.grid_for(vtkDataObject.GetData(in_info[0], 0)) if self.first_rank else None
        except (BadInput, ImportError):  # RequestData reports it
            grid = None
        self.announce(out_info, grid)
        return 1

    def announce(self, out_info: OutInfo, grid: Grid | None) -> None:
        """Announce a grid to the pipeline, or an empty one (see :func:`set_image_information`)."""
        info = out_info.GetInformationObject(0)
        shape = (0, 0, 0) if grid is None else grid.shape
        origin, spacing = ((0.0,) * 3, 1.0) if grid is None else (grid.origin, grid.spacing)
        extent = [end for count in shape for end in (0, count - 1)]
        info.Set(self.GetExecutive().WHOLE_EXTENT(), extent, 6)
        info.Set(vtkDataObject.SPACING(), (spacing,) * 3, 3)
        info.Set(vtkDataObject.ORIGIN(), origin, 3)
