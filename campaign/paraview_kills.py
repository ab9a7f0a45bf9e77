"""Kills ParaView at random moments of its filters' work: ``python -m campaign.paraview_kills --times 60``.

A session in the real ParaView trains a scene, edits and paints it, and saves each result. It is killed four times in a
row, with SIGKILL or with what a closed window or terminal sends. After each kill, what was kept is the same bytes,
every file with a final name opens, and no process is left. The session after the last kill has to end well; it goes on
from what was kept.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path

from campaign import small
from campaign.paraview_long import ROOT, write_files
from svv.io.files.cache import NAME
from svv.pv.launch import programs

SIGNALS = (signal.SIGKILL, signal.SIGTERM, signal.SIGHUP, signal.SIGINT)

IN_A_ROW = 4
"""Kills of a session before it may end."""

SESSION = """
import sys
from paraview.simple import *
folder, seed = sys.argv[1:]
wavelet = Wavelet(WholeExtent=[-12, 12] * 3)
view = CreateView("RenderView")
display = Show(wavelet, view)
display.SetRepresentationType("Volume")
ColorBy(display, ("POINTS", "RTData"))
GetOpacityTransferFunction("RTData").Points = [37, 0, .5, 0, 200, 0, .5, 0, 220, 1, .5, 0, 277, 1, .5, 0]
print("BEGUN", flush=True)
train = StyleRFTrain(Input=wavelet, Preset="draft", TimeLimit=2.0, Seed=int(seed), Views=8, ViewSize=64,
                     SceneFile=folder + "/trained.svv")
train.UpdatePipeline()
edit = StyleRFEdit(Input=train, Region0Recolour=1, Region0Colour=[.2, .4, .9], SaveFile=folder + "/edited.svv")
edit.UpdatePipeline()
edit.SaveScene()
paint = StyleRFStylize(Input=edit, StyleFiles=[folder + "/halves.png"], Preset="draft")
paint.SaveFile = folder + "/painted.svv"
paint.UpdatePipeline()
paint.SaveScene()
paint.UpdatePropertyInformation()
print("PAINTED", paint.Status, flush=True)
"""


@dataclass
class Trial:
    """A session that was killed several times in a row, and then ran to its end."""

    kills: list[tuple[str, float, int]] = field(default_factory=list)
    """Signal, seconds after the session has begun, and exit code of each kill."""
    repeated: float = 0.0
    """Seconds of work done twice per kill, at most."""
    wrong: list[str] = field(default_factory=list)


class Sessions:
    """Sessions in one folder."""

    def __init__(self, folder: Path, environ: Mapping[str, str], seed: int) -> None:
        self.folder = folder
        write_files(folder)
        script = folder / "session.py"
        script.write_text(SESSION)
        self.command = [str(programs.find().program("pvpython")), str(script), str(folder), str(seed)]
        self.environ = {**environ, "TMPDIR": str(folder / "tmp"), "SVV_CACHE": str(folder / "cache")}

    def begun(self) -> subprocess.Popen[str]:
        """Start a session, and return it when it has loaded ParaView."""
        session = subprocess.Popen(
            self.command, env=self.environ, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
            start_new_session=True,
        )  # fmt: skip
        assert session.stdout is not None
        said = ""
        for line in session.stdout:
            said += line
            if line.startswith("BEGUN"):
                return session
        raise RuntimeError(f"ParaView does not begin: {said}")

    def whole(self) -> tuple[float, str]:
        """Run a session to its end; return the seconds of its work, and what it said if it did not end well."""
        session, begin = self.begun(), time.monotonic()
        said, _ = session.communicate(timeout=300)
        good = session.returncode == 0 and "PAINTED" in said and "Traceback" not in said
        return time.monotonic() - begin, "" if good else f"{session.returncode} {said[-1500:]}"

    def scenes(self) -> dict[str, bytes]:
        """Return the files that users have, and those that the filters keep."""
        return {name: content for name, content in small.files_in(self.folder).items() if name.endswith(".svv")}

    def wrong(self, before: Mapping[str, bytes]) -> Iterator[str]:
        """Say what is lost, and what does not open."""
        now = self.scenes()
        for name in before:
            if name not in now:
                yield f"{name} is gone"
            elif now[name] != before[name] and not name.endswith(("trained.svv", "edited.svv", "painted.svv")):
                yield f"{name} is another file"
        yield from small.cannot_open(self.folder)
        for path in (self.folder / "cache").iterdir():
            if not path.name.startswith(".") and not (NAME.fullmatch(path.stem) or NAME.fullmatch(path.name)):
                yield f"{path.name} in the cache is no result"


def trial(sessions: Sessions, moments: list[tuple[signal.Signals, float]], seconds: float) -> Trial:
    """Kill sessions at moments, in seconds; look at what each left; let the last end, which alone takes ``seconds``."""
    found, spent = Trial(), 0.0
    for sent, after in moments:
        before, session = sessions.scenes(), sessions.begun()
        begin = time.monotonic()
        try:
            session.wait(after)
        except subprocess.TimeoutExpired:
            session.send_signal(sent)
        try:
            said, _ = session.communicate(timeout=20.0)
        except subprocess.TimeoutExpired:
            session.kill()
            said, _ = session.communicate()
            found.wrong.append(f"{sent.name} after {after:.1f} s did not end it: {said[-500:]}")
        spent += time.monotonic() - begin
        found.kills.append((sent.name, round(after, 2), session.returncode))
        found.wrong += [f"{sent.name} after {after:.1f} s: {text}" for text in sessions.wrong(before)]
        left = small.left_running(session.pid)
        found.wrong += [f"process {number} goes on" for number in left]
    last, said = sessions.whole()
    found.wrong += [f"in the end: {said}"] if said else []
    found.wrong += [f"in the end: {text}" for text in sessions.wrong({})]
    found.repeated = max(0.0, spent + last - seconds) / len(moments)
    return found


def main() -> int:
    """Run the campaign and write its table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--times", type=int, default=60, help="kills")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("paraview-kills.json"))
    chosen, done = parser.parse_args(), list[Trial]()
    at_random, paraview = random.Random(chosen.seed), programs.find()
    display, name = programs.start_display()
    environ = {**programs.environ_for(paraview), "DISPLAY": name}
    try:
        for number in range(-(-chosen.times // IN_A_ROW)):
            with tempfile.TemporaryDirectory() as place, tempfile.TemporaryDirectory() as other:
                seconds, said = Sessions(Path(other), environ, number).whole()
                assert not said, said
                moments = [(at_random.choice(SIGNALS), at_random.uniform(0.0, seconds)) for _ in range(IN_A_ROW)]
                done.append(trial(Sessions(Path(place), environ, number), moments, seconds))
            print(done[-1], flush=True)
            chosen.out.write_text(json.dumps([asdict(one) for one in done], indent=1))
    finally:
        display.terminate()
    bad = sum(bool(one.wrong) for one in done)
    most = max(one.repeated for one in done)
    print(
        f"{sum(len(one.kills) for one in done)} kills, {bad} sessions with something wrong; {most:.1f} s again at most"
    )
    return min(bad, 100)


if __name__ == "__main__":
    os.environ["PYTHONPATH"] = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")]).rstrip(os.pathsep)
    sys.exit(main())
