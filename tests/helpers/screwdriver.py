# SPDX-License-Identifier: Apache-2.0
"""A thin tool on a rough bench: a screwdriver of some 230 px, drawn anywhere."""

from typing import NamedTuple

import cv2
import numpy as np

WIDTH, HEIGHT = 480, 400
TOOL = np.array(
    [[-3, -120], [3, -120], [4, 0], [11, 8], [11, 90], [7, 110], [-7, 110], [-11, 90], [-11, 8], [-4, 0]], float
)
"""px of a screwdriver about its middle."""
MIDDLE = np.array([40.0, 150.0])
"""px where that lies in the picture of the tool."""


class Tool(NamedTuple):
    """How the tool is drawn: how large, in what grey level its handle, and the standard deviation of its print before blur."""

    scale: float = 1.0
    handle: float = 120.0
    print_sd: float = 10.0


SCREWDRIVER = Tool()


def drawn_tool(rng: np.random.Generator, tool: Tool) -> tuple[np.ndarray, np.ndarray]:
    """(300, 80) its grey levels, a light blade and a handle, and how much of each pixel it covers."""
    grey = np.full((300, 80), tool.handle, np.float32)
    grey[:150], grey[150:190] = 215.0, 90.0
    grey += tool.print_sd * cv2.GaussianBlur(rng.normal(size=grey.shape).astype(np.float32), (0, 0), 1.0)
    cover = np.zeros((1200, 320), np.uint8)
    cv2.fillPoly(cover, [np.round(4.0 * (TOOL + MIDDLE)).astype(int)], (255,))
    return grey, cv2.resize(cover, (80, 300), interpolation=cv2.INTER_AREA).astype(np.float32) / 255.0


def rough_bench(seed: int = 7) -> np.ndarray:
    """(HEIGHT, WIDTH) grey levels."""
    rough = np.random.default_rng(seed).normal(size=(HEIGHT, WIDTH)).astype(np.float32)
    return 70.0 + 60.0 * cv2.GaussianBlur(rough, (0, 0), 1.5)


def exposed(
    place: tuple[float, float], turn: float, seed: int, tool: Tool = SCREWDRIVER
) -> tuple[np.ndarray, np.ndarray]:
    """An image of the tool on a rough bench, and the (3, 3) pose that carries the tool's picture there."""
    grey, cover = drawn_tool(np.random.default_rng(3), tool)
    c, s = tool.scale * np.cos(turn), tool.scale * np.sin(turn)
    pose = np.array([[c, -s, place[0]], [s, c, place[1]], [0.0, 0.0, 1.0]])
    pose[:2, 2] -= pose[:2, :2] @ MIDDLE
    own = cv2.warpAffine(cover, pose[:2], (WIDTH, HEIGHT))
    lit = cv2.warpAffine(grey, pose[:2], (WIDTH, HEIGHT), borderMode=cv2.BORDER_REPLICATE)
    return taken(rough_bench() * (1.0 - own) + lit * own, seed), pose


def taken(grey: np.ndarray, seed: int) -> np.ndarray:
    """What a camera makes of grey levels (HEIGHT, WIDTH)."""
    noise = np.random.default_rng(seed).normal(0.0, 2.0, grey.shape)
    return np.clip(cv2.GaussianBlur(grey, (0, 0), 0.7) + noise, 0, 255).astype(np.uint8)
