"""The choice of a build of torch, tested with pip itself and a local index of tiny packages."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import threading
import urllib.parse
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

from svv.errors import BadInput
from svv.pv.launch import installer, torch_build
from tests.nightly import nightly
from tests.wheels import make_installed, make_torch, make_wheel

ROOT = Path(__file__).resolve().parents[2]
PIN = "torch==2.13.0"


class Index:
    """An index: its pages list the wheels in a folder; where it breaks off, it lists what it does not have."""

    def __init__(self, folder: Path) -> None:
        self.asked: list[str] = []
        self.breaks_off = False
        index = self

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                index.asked.append(self.path)
                path = urllib.parse.unquote(urllib.parse.urlsplit(self.path).path).strip("/")
                body = None
                if path.endswith(".whl"):
                    body = None if index.breaks_off else (folder / Path(path).name).read_bytes()
                elif path == "torch":
                    names = [urllib.parse.quote(file.name) for file in folder.glob("torch-*.whl")]
                    body = "".join(f'<a href="{name}">{name}</a>' for name in names).encode()
                self.send_response(404 if body is None else 200)
                self.send_header("Content-Type", "text/html")
                self.send_header("Content-Length", str(len(body or b"")))
                self.end_headers()
                self.wfile.write(body or b"")

            def log_message(self, *arguments: object) -> None:
                pass

        self.server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.address = f"http://127.0.0.1:{self.server.server_port}"
        threading.Thread(target=self.server.serve_forever, daemon=True).start()

    def end(self) -> None:
        """Answer no more."""
        self.server.shutdown()
        self.server.server_close()


@pytest.fixture
def torchs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Index]:
    """torch's own index; pip by itself finds the build with CUDA, as it does on Linux."""
    make_torch(make_wheel, tmp_path / "pip finds", "2.13.0", "13.0")
    make_torch(make_wheel, tmp_path / "torch's", "2.13.0+cpu", None)
    for name in [name for name in os.environ if name.startswith("PIP_") or name.lower().endswith("_proxy")]:
        monkeypatch.delenv(name)
    finds = Index(tmp_path / "pip finds")
    index = Index(tmp_path / "torch's")
    monkeypatch.setenv("PIP_CONFIG_FILE", os.devnull)
    monkeypatch.setenv("PIP_INDEX_URL", finds.address)
    monkeypatch.setenv("SVV_TORCH_INDEX", index.address)
    monkeypatch.setattr(torch_build, "_pip_finds_cuda", lambda: True)
    monkeypatch.setattr(torch_build, "has_nvidia_gpu", lambda: False)
    yield index
    for one in (finds, index):
        one.end()


def installs(folder: Path, choice: str) -> torch_build.Torch | None:
    torch_build.install(choice, None, PIN, "--target", str(folder))
    return torch_build.installed([folder])


CPU, CUDA = torch_build.Torch("2.13.0+cpu", False), torch_build.Torch("2.13.0", True)


@pytest.mark.parametrize(
    ("choice", "gpu", "build", "line"),
    nightly(
        [
            ("auto", False, CPU, "because there is no NVIDIA GPU; TORCH=cuda selects the other build"),
            ("auto", True, CUDA, "because there is an NVIDIA GPU; TORCH=cpu selects the other build"),
            ("cpu", True, CPU, "as you chose; TORCH=cuda selects the other build"),
            ("cuda", False, CUDA, "as you chose; TORCH=cpu selects the other build"),
        ],
        ("auto", False, CPU, "because there is no NVIDIA GPU; TORCH=cuda selects the other build"),
        ("cuda", False, CUDA, "as you chose; TORCH=cpu selects the other build"),
    ),
)
def test_the_build_is_that_of_the_machine_or_of_the_user(
    torchs: Index, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys, choice: str, gpu: bool, build, line: str
) -> None:
    monkeypatch.setattr(torch_build, "has_nvidia_gpu", lambda: gpu)
    assert installs(tmp_path / "out", choice) == build
    said = capsys.readouterr().err.splitlines()
    assert len(said) == 1
    assert line in said[0]
    assert torch_build.ABOUT["cuda" if build.cuda else "cpu"] in said[0]
    assert bool(torchs.asked) == (build is CPU)


def test_where_the_index_does_not_answer_pip_decides_and_the_line_says_so(
    torchs: Index, tmp_path: Path, capsys
) -> None:
    torchs.end()
    assert installs(tmp_path / "out", "auto") == CUDA
    assert f"because {torchs.address} cannot be reached" in capsys.readouterr().err
    with pytest.raises(BadInput, match=r"not available, because .* cannot be reached: name a mirror"):
        installs(tmp_path / "other", "cpu")
    assert torch_build.installed([tmp_path / "other"]) is None


def test_an_index_that_breaks_off_does_not_break_the_installation(torchs: Index, tmp_path: Path, capfd) -> None:
    torchs.breaks_off = True
    assert installs(tmp_path / "out", "auto") == CUDA
    assert f"because the download from {torchs.address} failed" in capfd.readouterr().err
    with pytest.raises(BadInput, match=r"the download from .* failed"):
        installs(tmp_path / "other", "cpu")


def test_a_build_for_the_processor_in_a_place_of_the_users_will_do(
    torchs: Index, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    torchs.end()
    monkeypatch.setenv("PIP_FIND_LINKS", (tmp_path / "torch's").as_uri())
    assert installs(tmp_path / "out", "cpu") == CPU


def test_an_index_is_asked_through_the_proxy(torchs: Index, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("no_proxy", "")
    assert not torch_build.answers("http://torch.invalid")
    monkeypatch.setenv("http_proxy", torchs.address)
    assert torch_build.answers("http://torch.invalid")
    assert torchs.asked == ["http://torch.invalid/torch/"]


def test_an_index_that_says_nothing_is_not_waited_for() -> None:
    with socket.create_server(("127.0.0.1", 0)) as silent:
        assert not torch_build.answers(f"http://127.0.0.1:{silent.getsockname()[1]}", within=0.2)


@pytest.mark.parametrize(
    ("there", "cuda", "choice", "source", "replace"),
    nightly(
        [
            ("2.13.0+cpu", None, "auto", "keep", False),
            ("2.2.1", "12.1", "auto", "keep", False),
            ("2.10.0", "12.1", "keep", "keep", False),
            ("2.1.2", None, "auto", "index", False),
            ("2.13.0", "13.0", "cpu", "index", True),
            ("2.13.0+cpu", None, "cuda", "pip", True),
            ("2.13.0+cpu", None, "cpu", "keep", False),
            ("2.13.0", "13.0", "cuda", "keep", False),
        ],
        ("2.13.0+cpu", None, "auto", "keep", False),
        ("2.1.2", None, "auto", "index", False),
        ("2.13.0", "13.0", "cpu", "index", True),
        ("2.13.0+cpu", None, "cuda", "pip", True),
    ),
)
def test_a_torch_that_is_there_and_fits_stays(
    torchs: Index, tmp_path: Path, there: str, cuda: str | None, choice: str, source: str, replace: bool
) -> None:
    make_torch(make_installed, tmp_path / "packages", there, cuda)
    plan = torch_build.plan(choice, torch_build.installed([tmp_path / "packages"]))
    assert (plan.source, plan.replace) == (source, replace)


def test_there_must_be_something_to_keep(tmp_path: Path) -> None:
    make_torch(make_installed, tmp_path, "2.1.2", None)
    for there in (None, torch_build.installed([tmp_path])):
        with pytest.raises(BadInput, match=r"no torch 2\.2 or newer to keep"):
            torch_build.plan("keep", there)


def test_a_gpu_is_found_by_its_driver_or_by_its_tool(tmp_path: Path) -> None:
    assert not torch_build.has_nvidia_gpu(tmp_path, "/nowhere")
    tool = tmp_path / "nvidia-smi"
    tool.write_text("#!/bin/sh\necho 'NVIDIA-SMI has failed'; exit 9\n")
    tool.chmod(0o755)
    assert not torch_build.has_nvidia_gpu(tmp_path, str(tmp_path))
    tool.write_text("#!/bin/sh\necho 'GPU 0: a fast one'\n")
    assert torch_build.has_nvidia_gpu(tmp_path, str(tmp_path))
    (tmp_path / "dev").mkdir()
    (tmp_path / "dev" / "nvidiactl").touch()
    assert not torch_build.has_nvidia_gpu(tmp_path, "/nowhere")
    (tmp_path / "dev" / "nvidia0").touch()
    assert torch_build.has_nvidia_gpu(tmp_path, "/nowhere")


def test_make_keeps_this_torch_and_pins_it(tmp_path: Path) -> None:
    here = torch_build.installed()
    assert here is not None
    command = [sys.executable, "-m", "svv.pv.launch.torch_build", str(tmp_path / "constraints.txt")]
    environ = {**os.environ, "TORCH": ""}
    done = subprocess.run(command, cwd=ROOT, env=environ, capture_output=True, text=True)
    assert done.stderr == f"torch {here.version} is installed already; TORCH=cpu|cuda selects another build.\n"
    assert done.returncode == 0
    pins = (tmp_path / "constraints.txt").read_text().splitlines()
    assert f"torch=={here.version}" in pins
    assert PIN not in pins or here.version == "2.13.0"
    environ["TORCH"] = "rocm"
    done = subprocess.run(command, cwd=ROOT, env=environ, capture_output=True, text=True)
    assert done.returncode == 2
    assert "choose one of" in done.stderr


@pytest.mark.parametrize("python", [(3, 10), (3, 11), (3, 12), (3, 13), (3, 14)])
def test_each_python_has_one_version_of_each_package(python: tuple[int, int]) -> None:
    pins = dict(pin.split("==") for pin in installer.pins(ROOT / "constraints.txt", python))
    assert len(pins) == len(installer.pins(ROOT / "constraints.txt", python))
    assert tuple(map(int, pins["numpy"].split(".")[:2])) < (2, 4)
    assert (pins["numpy"] == "2.2.6") == (python < (3, 11))


def test_a_marker_that_nobody_reads_is_no_pin_for_all(tmp_path: Path) -> None:
    (tmp_path / "constraints.txt").write_text("a==1; sys_platform == 'linux'\n")
    with pytest.raises(ValueError, match="is not supported"):
        installer.pins(tmp_path / "constraints.txt", (3, 11))


def test_without_a_pip_of_its_own_another_or_uv_installs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert installer.command()[:4] == [sys.executable, "-m", "pip", "install"]
    monkeypatch.setattr("svv.pv.launch.installer.importlib.util.find_spec", lambda name: None)
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(BadInput, match="-m ensurepip"):
        installer.command()
    for name in ("uv", "pip3", "pip"):
        (tmp_path / name).write_text("#!/bin/sh\ncase $* in *--version) exit 0;; esac; exit 9\n")
        (tmp_path / name).chmod(0o755)
    assert installer.command()[:4] == [str(tmp_path / "pip"), "--python", sys.executable, "install"]
    for name in ("pip", "pip3"):
        (tmp_path / name).write_text("#!/bin/sh\nexit 2\n")  # older than pip 22.3
    assert installer.command()[:3] == [str(tmp_path / "uv"), "pip", "install"]
