"""Beginning of scripts with data that change over time: a blob that moves, as a source that notes its requests."""

from __future__ import annotations

from filter_script import VOLUME  # type: ignore[import-not-found]

TIMES = "[0.0, 0.5, 1.0, 1.5, 2.0]"

BLOB = (
    VOLUME
    + f"""
import numpy as np
from svv.job import request
from svv.pv.work import engine, requests
from svv.pv.display.linked_camera import fit, show_image
times = {TIMES}
counted = []
def counting(module, name):
    plain = getattr(module, name)
    setattr(module, name, lambda *given, **more: (counted.append(name), plain(*given, **more))[1])
for module in (engine, requests):  # of StyleRF Views, and of what learns from a volume
    counting(module, "draw_views")
counting(request, "train_scene")

def blob(time, size=16):
    z, y, x = np.mgrid[0:size, 0:size, 0:size]
    return np.exp(-((x - 4 - 4 * time) ** 2 + (y - 8) ** 2 + (z - 8) ** 2) / 14.0).astype(np.float32)

def as_volume(source):
    view = CreateView("RenderView")
    view.ViewSize = [80, 60]
    display = Show(source, view)
    display.SetRepresentationType("Volume")
    ColorBy(display, ("POINTS", "v"))
    table, opacity = GetColorTransferFunction("v"), GetOpacityTransferFunction("v")
    table.RescaleTransferFunction(0.0, 1.0)
    opacity.Points = [0.0, 0.0, 0.5, 0.0, 0.3, 0.0, 0.5, 0.0, 1.0, 0.8, 0.5, 0.0]
    Render(view)
    animation = GetAnimationScene()
    animation.UpdateAnimationUsingDataTimeSteps()
    return animation

def as_image(filter):
    view = CreateView("RenderView")
    view.ViewSize = [80, 60]
    show_image(filter, view)
    fit(view, 40, 30)
    Render(view)
    return view

def at(animation, time, *views):
    animation.AnimationTime = time
    for view in views:
        Render(view)

def steps(animation):
    return [float(time) for time in animation.TimeKeeper.TimestepValues]
"""
)

SOURCE = (
    BLOB
    + """
noted = sys.argv[1] + "/asked"  # numpy's names come into __main__ with the source
def asked():
    there = [eval(line) for line in open(noted)] if os.path.exists(noted) else []
    open(noted, "w").close()
    return there

source = ProgrammableSource(OutputDataSetType="vtkImageData")
source.ScriptRequestInformation = '''
executive = self.GetExecutive()
info = executive.GetOutputInformation(0)
info.Remove(executive.TIME_STEPS()); info.Remove(executive.TIME_RANGE())
for time in TIMES: info.Append(executive.TIME_STEPS(), time)
for time in (TIMES[0], TIMES[-1]): info.Append(executive.TIME_RANGE(), time)
info.Set(executive.WHOLE_EXTENT(), 0, 15, 0, 15, 0, 15)
'''.replace("TIMES", str(times))
SCRIPT = '''
import builtins
import numpy as np
from vtkmodules.util.numpy_support import numpy_to_vtk
executive = self.GetExecutive()
info = executive.GetOutputInformation(0)
time = info.Get(executive.UPDATE_TIME_STEP()) if info.Has(executive.UPDATE_TIME_STEP()) else None
with open("LOG", "a") as file:
    file.write(repr(time) + chr(10))
shown = builtins.max(t for t in TIMES if t <= (time or 0.0))
z, y, x = np.mgrid[0:16, 0:16, 0:16]
values = np.exp(-((x - 4 - 4 * shown) ** 2 + (y - 8) ** 2 + (z - 8) ** 2) / 14.0).astype(np.float32)
array = numpy_to_vtk(values.ravel(), deep=1)
array.SetName("v")
output = self.GetOutput()
output.SetDimensions(16, 16, 16)
output.GetPointData().SetScalars(array)
output.GetInformation().Set(output.DATA_TIME_STEP(), shown)
'''.replace("TIMES", str(times)).replace("LOG", noted)
source.Script = SCRIPT
animation = as_volume(source)
assert steps(animation) == times
"""
)
