"""Small Cinema databases of three balls, drawn by casting rays, for tests."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image

from svv.core.geometry.cameras import Camera
from svv.core.geometry.phi_theta import paraview_rotations

BALLS = ((0.9, 0.3, -0.2, 0.5), (-0.8, 0.7, 0.4, 0.4), (-0.1, -0.9, 0.6, 0.6))
"""Centre and radius, about the focal point, of balls with unlike silhouettes from all sides."""

DISTANCE = 6.0


def cameras(angles: Sequence[tuple[float, float]], fov: float = np.radians(30.0), size: int = 64) -> list[Camera]:
    found = []
    for rotation in paraview_rotations(*np.array(angles, float).T):
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = rotation, DISTANCE * rotation[:, 2]
        found.append(Camera(matrix, float(fov), size, size))
    return found


def picture(camera: Camera, balls: Sequence[tuple[float, ...]] = BALLS) -> np.ndarray:
    """What a camera sees: balls of three colours, half transparent. (h, w, 4) uint8"""
    origins, directions = camera.rays()
    image = np.zeros((*origins.shape[:2], 4), np.uint8)
    for k, (x, y, z, radius) in enumerate(balls):
        towards = np.array((x, y, z)) - origins
        along = (towards * directions).sum(-1)
        hit = (towards**2).sum(-1) - along**2 < radius**2
        colour = np.roll((220, 90, 40), k)
        image[hit] = (*colour, 128 + 40 * k)
    return image


def turns(phis: int = 8, thetas: int = 7) -> list[tuple[float, float]]:
    """Angles as ParaView's extractor counts them; an odd number of thetas repeats no direction."""
    return [(360.0 * p / phis, 360.0 * t / thetas) for p in range(phis) for t in range(thetas)]


def write(
    folder: Path, angles: Sequence[tuple[float, float]] | None = None, fov: float = np.radians(30.0), size: int = 64
) -> list[dict[str, str]]:
    """Write a database as ParaView does, and return its rows."""
    folder.mkdir(parents=True, exist_ok=True)
    rows = []
    for (phi, theta), camera in zip(angles or turns(), cameras(angles or turns(), fov, size)):
        name = f"RenderView1_000000p={phi:06.2f}t={theta:06.2f}.png"
        Image.fromarray(picture(camera)).save(folder / name)
        rows.append({"phi": f"{phi:06.2f}", "producer": "RenderView1", "theta": f"{theta:06.2f}", "time": "0"})
        rows[-1]["FILE_png"] = name
    save_rows(folder, rows)
    return rows


def save_rows(folder: Path, rows: Sequence[dict[str, str]]) -> None:
    with (folder / "data.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)


def write_over(
    folder: Path, background: float, angles: Sequence[tuple[float, float]] | None = None
) -> list[dict[str, str]]:
    """Write a database whose images have a grey background instead of alpha, and return its rows."""
    rows = write(folder, angles)
    for row in rows:
        file = folder / row["FILE_png"]
        with Image.open(file) as image:
            flat = over(np.asarray(image), background)
        Image.fromarray(flat).save(file)
    return rows


def over(image: np.ndarray, background: float) -> np.ndarray:
    """An image over a grey background, without alpha. (h, w, 3) uint8"""
    alpha = image[..., 3:] / 255.0
    return np.rint(image[..., :3] * alpha + background * (1.0 - alpha)).astype(np.uint8)
