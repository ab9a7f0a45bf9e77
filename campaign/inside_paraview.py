"""The operations of a long run, in ParaView's process: those of StyleRF's filters, or the same of ParaView's own.

Run by :mod:`campaign.paraview_long` with its arguments as JSON.
"""

from __future__ import annotations

import json
import math
import random
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from paraview import servermanager, simple
from paraview_gauge import Gauge  # type: ignore[import-not-found]

from svv.pv.display import linked_camera

ROUND = ("apply", "edit", "stylize", "undo", "delete")
"""Operations on a pipeline; those between the first and the last come in any order."""

FUNCTIONS = ("lookup_tables", "piecewise_functions", "transfer_2d_functions")
"""Groups of ParaView's transfer functions. They outlive what they colour, and each load of a state adds as many."""


class Pipeline:
    """A source, and filters behind it that are made, changed and deleted as a user does it."""

    def __init__(self, folder: Path, chance: random.Random) -> None:
        self.folder, self.chance = folder, chance
        self.view = simple.CreateView("RenderView")
        self.view.ViewSize = [48, 48]
        self.source = self.open()
        self.filters: list[Any] = []
        self.seconds = 5.0

    def draw(self) -> None:
        """Draw the view."""
        simple.Render(self.view)

    def show(self) -> None:
        """Show the last filter only."""
        simple.Show(self.filters[-1], self.view)
        self.draw()

    def delete(self) -> None:
        """Delete all filters, the last one first, which deletes what shows it, too."""
        while self.filters:
            simple.Delete(self.filters.pop())
        self.draw()

    def place(self) -> list[float]:
        """Return a camera on a circle, as ten numbers."""
        angle = self.chance.uniform(0.0, 6.28)
        return [40.0 * math.cos(angle), 40.0 * math.sin(angle), 5.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 30.0]

    def turn(self) -> None:
        """Turn the view's camera as the mouse does."""
        self.view.GetActiveCamera().Azimuth(self.chance.uniform(-60.0, 60.0))
        self.view.GetInteractor().InvokeEvent("EndInteractionEvent")
        self.draw()

    def open(self) -> Any:
        """Return the source."""
        raise NotImplementedError

    def apply(self) -> None:
        """Add two filters, and show the second."""
        raise NotImplementedError

    def edit(self) -> None:
        """Change the first filter."""
        raise NotImplementedError

    def stylize(self) -> None:
        """Put another filter between the two."""
        raise NotImplementedError

    def undo(self) -> None:
        """Undo the change of the first filter."""
        raise NotImplementedError

    def moves(self) -> list[Callable[[], None]]:
        """Return functions each of which moves a camera, and brings the image up to date."""
        raise NotImplementedError


class Ours(Pipeline):
    """StyleRF Edit, Stylize (its preview) and Render behind a scene's file."""

    def open(self) -> Any:
        return simple.OpenDataFile(str(self.folder / "cube.svv"))

    def apply(self) -> None:
        edit = simple.StyleRFEdit(Input=self.source)
        self.filters = [edit, simple.StyleRFRender(Input=edit, ImageSize=[24, 24])]
        self.show()

    def edit(self) -> None:
        edit, region = self.filters[0], self.chance.randrange(3)
        setattr(edit, f"Region{region}Recolour", 1)
        setattr(edit, f"Region{region}Colour", [self.chance.random() for _ in range(3)])
        setattr(edit, f"Region{region}Opacity", self.chance.random())
        self.draw()

    def stylize(self) -> None:
        picture = str(self.folder / "halves.png")
        paint = simple.StyleRFStylize(Input=self.filters[0], StyleFiles=[picture], PreviewOnly=1)
        paint.Region0Positive = f"{self.chance.randrange(80)},{self.chance.randrange(60)}"
        self.filters.insert(1, paint)
        self.filters[-1].Input = paint
        self.draw()

    def undo(self) -> None:
        self.filters[0].UndoEdit()

    def moves(self) -> list[Callable[[], None]]:
        linked_camera.LARGEST = 48
        volume = shown_volume(self.view)
        self.draw()
        painted = simple.StyleRFStylizedView(Input=volume, Preset="draft", TimeLimit=2.0, ImageSize=[24, 24])
        painted.Views, painted.ViewSize = 8, 64
        painted.UpdatePipeline()
        image, live = (simple.StyleRFRender(Input=self.source, ImageSize=[24, 24]) for _ in range(2))
        live.UpdatePipeline()
        live.FollowCamera = 1
        self.draw()
        assert linked_camera.follower_of(live) is not None

        def move(filter: Any) -> None:
            filter.Camera = self.place()
            filter.UpdatePipeline()

        return [self.turn, lambda: move(image), lambda: move(painted)]


class Theirs(Pipeline):
    """ParaView's own filters, as many of them and used in the same way."""

    def open(self) -> Any:
        return simple.Wavelet(WholeExtent=[-4, 4] * 3)

    def apply(self) -> None:
        first = simple.Calculator(Input=self.source, Function="RTData")
        self.filters = [first, simple.Contour(Input=first, ContourBy=["POINTS", "RTData"], Isosurfaces=[150.0])]
        self.show()

    def edit(self) -> None:
        self.before = self.filters[0].Function
        self.filters[0].Function = f"RTData + {self.chance.random()}"
        self.draw()

    def stylize(self) -> None:
        added = simple.Elevation(Input=self.filters[0])
        added.LowPoint = [self.chance.random() for _ in range(3)]
        self.filters.insert(1, added)
        self.filters[-1].Input = added
        self.draw()

    def undo(self) -> None:
        self.filters[0].Function = "RTData"
        self.draw()

    def moves(self) -> list[Callable[[], None]]:
        self.apply()
        plane = simple.Slice(Input=self.source, SliceType="Plane")

        def move() -> None:
            plane.SliceType.Normal = self.place()[:3]
            plane.UpdatePipeline()

        return [self.turn, move]


def operations(pipeline: Pipeline) -> Callable[[], None]:
    """Return a function that does the next of :data:`ROUND` each time it is called."""
    todo: list[str] = []

    def step() -> None:
        if not todo:
            between = list(ROUND[1:-1])
            pipeline.chance.shuffle(between)
            todo[:] = [ROUND[0], *between, ROUND[-1]]
        getattr(pipeline, todo.pop(0))()

    return step


def cameras(pipeline: Pipeline) -> Callable[[], None]:
    """Return a function that moves one of several cameras each time it is called."""
    moves = pipeline.moves()
    return lambda: pipeline.chance.choice(moves)()


def states(pipeline: Pipeline) -> Callable[[], None]:
    """Return a function that saves a state, and loads it into an empty session, each time it is called."""
    file, manager = str(pipeline.folder / "state.pvsm"), servermanager.ProxyManager()
    pipeline.apply()

    def step() -> None:
        simple.SaveState(file)
        for proxy in [*reversed(simple.GetSources().values()), *simple.GetViews(), *simple.GetLayouts().values()]:
            simple.Delete(proxy)
        for group in FUNCTIONS:
            for (name, _), proxy in list(manager.GetProxiesInGroup(group).items()):
                manager.UnRegisterProxy(group, name, proxy)
        simple.LoadState(file)
        simple.RenderAllViews()

    return step


def trainings(pipeline: Pipeline) -> Callable[[], None]:
    """Return a function that trains a scene, and deletes it, each time it is called."""
    volume = shown_volume(pipeline.view)
    seeds = iter(range(10**6))  # each training is another: what was trained before is kept

    def step() -> None:
        train = simple.StyleRFTrain(Input=volume, Preset="draft", TimeLimit=pipeline.seconds, Seed=next(seeds))
        train.Views, train.ViewSize = 8, 64
        train.UpdatePipeline()
        train.UpdatePropertyInformation()
        assert "trained in" in train.Status, train.Status
        simple.Delete(train)

    return step


def shown_volume(view: Any) -> Any:
    """Return a small volume that a view shows."""
    volume = simple.Wavelet(WholeExtent=[-12, 12] * 3)
    display = simple.Show(volume, view)
    display.SetRepresentationType("Volume")
    simple.ColorBy(display, ("POINTS", "RTData"))
    points = [37, 0, 0.5, 0, 200, 0, 0.5, 0, 220, 1, 0.5, 0, 277, 1, 0.5, 0]
    simple.GetOpacityTransferFunction("RTData").Points = points
    return volume


PHASES = {"operations": operations, "cameras": cameras, "states": states, "trainings": trainings}


def repeat(gauge: Gauge, phase: str, step: Callable[[], None], count: int, samples: int, minutes: float) -> None:
    """Do an operation many times, with as many samples at equal distances, always after whole rounds."""
    whole, end = len(ROUND) if phase == "operations" else 1, time.monotonic() + 60.0 * minutes
    every = max(count // samples // whole, 1) * whole
    gauge.sample(phase, 0)
    for done in range(1, count + 1):
        step()
        late = done % whole == 0 and time.monotonic() > end
        if done % every == 0 or late:
            gauge.sample(phase, done)
        if late:
            break


def main(given: dict[str, Any]) -> None:
    """Do what the arguments ask for."""
    kind = {"ours": Ours, "theirs": Theirs}[given["kind"]]
    with open(given["out"], "a") as file:
        gauge = Gauge(file, [Path(folder) for folder in given["temporary"]])
        for phase, count in given["counts"].items():
            pipeline = kind(Path(given["folder"]), random.Random(given["seed"]))
            pipeline.seconds = given["seconds"]
            repeat(gauge, phase, PHASES[phase](pipeline), count, given["samples"], given["minutes"])


if __name__ == "__main__":
    main(json.loads(sys.argv[1]))
