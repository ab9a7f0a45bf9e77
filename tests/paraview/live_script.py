"""Beginning of the scripts that test Live: small filters as the window has them, and functions to wait for them."""

from __future__ import annotations

from tests.paraview.filter_script import VOLUME

LIVE = f"""{VOLUME}
import glob, time
import numpy as np
from svv.pv.live import sharpening
from svv.pv.live.sharpening import in_window
from svv.pv.display import linked_camera
wavelet, display = shown()
last = {{}}
FEW = dict(Preset="draft", Views=8, ViewSize=64, Device="cpu",
           Settings="reconstruct.iterations=60; recolour.iterations=30; stylize.style_views=4")
LONG = {{**FEW, "Settings": "reconstruct.iterations=20000"}}
folder = sys.argv[1]

def make(style="brush", window=1, **values):
    usual = dict(StyleFiles=[f"{{folder}}/{{style}}.png"], StrokeSize=2.0)  # painting takes a third of the time
    filter = StyleRFStylizedView(Input=wavelet, ImageSize=[64, 64], **{{**usual, **values}})
    if window:
        in_window(filter)
    return filter

def news(filter):
    told = filter.SMProxy.GetProperty("Learned")
    filter.SMProxy.UpdatePropertyInformation(told)
    return told.GetElement(0)

def look(filter):
    # What the window's timer does.
    now = news(filter)
    if now != last.get(filter.SMProxy):
        last[filter.SMProxy] = now
        sharpening._show(filter.SMProxy, now)
    return status(filter)

def until(filter, test, within=250):
    end = time.monotonic() + within
    while True:
        told = look(filter)
        if test(told):
            return told
        assert time.monotonic() < end, told
        time.sleep(0.1)

def sharp(told):
    return is_done(told) and "sharper" not in told

def loaded():
    return [name for name in ("torch", "numba") if name in sys.modules]

def press(filter, button):
    filter.SMProxy.InvokeCommand(button)

def workers(kind="svv.pv.live.learner"):
    found = []
    for file in glob.glob("/proc/[0-9]*/cmdline"):
        try:
            text, stat = open(file).read(), open(file.replace("cmdline", "stat")).read()
        except OSError:
            continue
        if kind in text and int(stat.rsplit(")", 1)[1].split()[1]) == os.getpid():
            found.append(int(file.split("/")[2]))
    return found

def is_done(told):
    return "regions, learned" in told

def sketched(told):
    return "A sketch is shown" in told
"""
