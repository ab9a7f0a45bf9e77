"""Settings and scenes that tests share."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
import torch
from hypothesis import settings

if TYPE_CHECKING:
    from svv.fields.scene.scene import Scene
    from svv.styles.weight_files import State
    from tests.browser import Opened

# Tests measure with what lies in bench/, and so do the processes that they start, whether it is installed or not.
BENCH = str(Path(__file__).resolve().parents[1] / "bench")
os.environ["PYTHONPATH"] = os.pathsep.join([BENCH, os.environ.get("PYTHONPATH", "")]).rstrip(os.pathsep)

# Machines differ in speed, and compiled kernels build on their first call: no test may fail for the time it takes.
# Twenty examples each, always the same, find what a change breaks, and pass on everybody's machine if they pass on one;
# --hypothesis-profile thorough (make test-slow) looks for what nobody thought of, with 300 others each time.
settings.register_profile("svv", deadline=None, max_examples=20, derandomize=True)
settings.register_profile("thorough", deadline=None, max_examples=300)
settings.load_profile("svv")


LONGEST = """
test_request test_looks paraview/test_filters test_web test_demo test_learning paraview/test_scripts test_brushing
test_dividing paraview/test_live test_legibility test_docs test_docstrings paraview/test_start test_stroke_edits
paraview/test_own_edits paraview/test_pairs test_web_cuts test_jumps test_web_doubt test_time_steps test_training
paraview/test_panels_requests paraview/test_strict paraview/test_panel test_hand test_variables test_colour_vision
""".split()
"""The modules that take longest, which come first, so that the workers end at about the same time."""


def pytest_configure(config: pytest.Config) -> None:
    """Leave out tests of what measures where nothing that they import has changed (``make test``)."""
    from tests.unchanged import Unchanged

    config.pluginmanager.register(Unchanged(config))


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the longest modules."""
    place = {f"tests/{name}.py": number for number, name in enumerate(LONGEST)}
    items.sort(key=lambda item: place.get(item.nodeid.partition("::")[0], len(place)))


def threads_each() -> int:
    """Return how many threads a process may use so that those that test at the same time share the cores."""
    return max(1, (os.cpu_count() or 1) // int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1")))


@pytest.fixture
def small_files() -> Iterator[None]:
    """Files may have 700 bytes at most, also those that other programs write, such as the movie encoder."""
    import resource  # which Windows has not
    import signal

    before, handler = resource.getrlimit(resource.RLIMIT_FSIZE), signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (700, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, before)
    signal.signal(signal.SIGXFSZ, handler)


@pytest.fixture(scope="session", autouse=True)
def share_the_cores() -> None:
    """Two tests with two threads each on two cores take a fifth longer than with one; whoever sets a number gets it."""
    import numba
    import torch

    if "OMP_NUM_THREADS" not in os.environ:
        torch.set_num_threads(threads_each())
    if "NUMBA_NUM_THREADS" not in os.environ:
        numba.set_num_threads(threads_each())


@pytest.fixture(scope="module")
def broad_strokes() -> Iterator[None]:
    """Strokes are twice as broad and the preset draft looks from half as many views: a quarter of the time.

    For tests that ask what a painting is made of, and not how fine it is.
    """
    from dataclasses import replace

    from svv.train.paint import stroke_painting
    from svv.train.run.config import PRESETS

    draft = PRESETS["draft"]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(stroke_painting, "WIDTH", 2.0 * stroke_painting.WIDTH)
        patch.setitem(PRESETS, "draft", replace(draft, stylize=replace(draft.stylize, style_views=6, style_size=64)))
        yield


@pytest.fixture
def all_threads() -> Iterator[None]:
    """Kernels run on all threads that there are, even beside another test."""
    with on_all_threads():
        yield


@contextmanager
def on_all_threads() -> Iterator[None]:
    """What `all_threads` does, for fixtures of a whole module."""
    import numba

    before, torch_before = numba.get_num_threads(), torch.get_num_threads()
    numba.set_num_threads(numba.config.NUMBA_NUM_THREADS)
    torch.set_num_threads(os.cpu_count() or 1)
    yield
    numba.set_num_threads(before)
    torch.set_num_threads(torch_before)


@pytest.fixture
def every_step(monkeypatch: pytest.MonkeyPatch) -> None:
    """Training tells and saves every step, so that it can be stopped at any, however fast the machine is."""
    for name in ("SHOW_EVERY", "SAVE_EVERY"):
        monkeypatch.setattr(f"svv.train.run.loop.{name}", 0.0)


@pytest.fixture(scope="session", autouse=True)
def short_movies() -> Iterator[int]:
    """Pages are written with movies of two frames, unless a test asks how long they are. Gives the usual number."""
    from svv.render.web import page

    usual = page.MOVIE_FRAMES
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(page, "MOVIE_FRAMES", 2)
        yield usual


@pytest.fixture
def small_stills(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pages are written with a small picture from the front, which takes a tenth of the time."""
    monkeypatch.setattr("svv.render.web.page.FRONT_SIZE", 48)


@pytest.fixture(scope="session")
def cube() -> Scene:
    """A translucent cube, in which three regions lie about at random."""
    from tests.cube import cube_scene

    return cube_scene()


@pytest.fixture(scope="session")
def balls() -> Scene:
    """An orange and a blue ball side by side: two regions that do not mix."""
    from tests.balls import balls_scene

    return balls_scene()


@pytest.fixture(scope="session", autouse=True)
def of_the_user(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Mapping[str, str | None]]:
    """Tests neither fetch weights nor find the user's, or what they paint would depend on the machine.

    Commands do not compile ahead: each would start a process for that. Gives the variables as the user has set them.
    """
    empty = tmp_path_factory.mktemp("empty")
    ours = {"SVV_OFFLINE": "1", "SVV_WEIGHTS": str(empty / "weights"), "TORCH_HOME": str(empty / "torch")}
    ours["SVV_COMPILE_AHEAD"] = "0"
    before = {name: os.environ.get(name) for name in ours}
    with pytest.MonkeyPatch.context() as patch:
        for name, value in ours.items():
            patch.setenv(name, value)
        yield before


@pytest.fixture(scope="session")
def published(of_the_user: Mapping[str, str | None]) -> Callable[[str], State]:
    """The real weights of a network, ``vgg16`` or ``alexnet``, wherever they can be had; else the test is skipped."""
    from svv.styles import weights

    def get(name: str) -> State:
        with pytest.MonkeyPatch.context() as patch:
            for variable, value in of_the_user.items():
                if value is None:
                    patch.delenv(variable)
                else:
                    patch.setenv(variable, value)
            found = weights.first_use(name)
        if found is None:
            pytest.skip(f"{name}'s weights can neither be found nor fetched here: `svv features --get {name}` says why")
        return found.state

    return get


@pytest.fixture
def off_screen() -> None:
    """VTK can draw without a screen."""
    from svv.dvr.draw.casters import off_screen_window
    from svv.errors import BadInput

    try:
        off_screen_window().Finalize()
    except BadInput:
        pytest.skip("no off-screen OpenGL here")


@pytest.fixture(params=["cpu", "gpu"])
def mapper(request: pytest.FixtureRequest) -> str:
    """Each of VTK's ray casters."""
    if request.param == "gpu":
        request.getfixturevalue("off_screen")
    return str(request.param)


@pytest.fixture(scope="module")
def chromium() -> Iterator[Any]:
    """Chromium; where there is none, ``make test`` has said what is missing."""
    from tests.browser import browser, program

    if program() is None:
        pytest.skip("no browser here; Debian: sudo apt-get install chromium")
    with browser() as running:
        yield running


@pytest.fixture
def open_page(chromium: Any) -> Iterator[Callable[..., Opened]]:
    """Open a file in the browser; afterwards, nothing may have gone wrong, and nothing else have been asked for."""
    from tests.browser import Opened

    contexts: list[Any] = []
    pages: list[Opened] = []

    def start(path: Path, script: str = "", size: tuple[int, int] = (900, 600)) -> Opened:
        contexts.append(chromium.new_context(viewport={"width": size[0], "height": size[1]}))
        pages.append(Opened.at(path, contexts[-1], script))
        return pages[-1]

    yield start
    for context, opened in zip(contexts, pages):
        context.close()
        assert opened.wrong == []
        assert [url.partition(":")[0] for url in opened.asked if not url.startswith(("data:", "blob:"))] == ["file"]
