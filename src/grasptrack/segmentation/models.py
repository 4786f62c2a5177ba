# SPDX-License-Identifier: Apache-2.0
"""Models that segmenters can run: what they are, where they come from, and where they are kept. None is fetched unasked."""

from __future__ import annotations

import hashlib
import os
import urllib.error
import urllib.request
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from grasptrack.errors import InputError

_RELEASES = "https://github.com/danielgatis/rembg/releases/download/v0.0.0/"
_BLOCK = 1 << 16


class Model(NamedTuple):
    """One file that can be downloaded.

    Attributes:
        name: by which a segmenter is asked for.
        what: it does, in a few words.
        licence: of the weights.
        megabytes: size of the file.
        url: where it comes from.
        digest: algorithm and hash of the file, as "sha256:...".
        side: px, side of the square that the net takes.
    """

    name: str
    what: str
    licence: str
    megabytes: float
    url: str
    digest: str
    side: int


MODELS = (
    Model(
        "u2netp",
        "salient objects, small",
        "Apache-2.0",
        4.6,
        _RELEASES + "u2netp.onnx",
        "sha256:309c8469258dda742793dce0ebea8e6dd393174f89934733ecc8b14c76f4ddd8",
        320,
    ),
    Model(
        "u2net",
        "salient objects, large",
        "Apache-2.0",
        176.0,
        _RELEASES + "u2net.onnx",
        "md5:60024c5c889badc19c04ad937298a77b",
        320,
    ),
)
"""U^2-Net (Qin et al., Pattern Recognition 106, 2020) as ONNX, from the releases of rembg."""


def model_named(name: str) -> Model | None:
    """The model of that name, or None."""
    return next((m for m in MODELS if m.name == name), None)


def models_folder() -> Path:
    """Where models are kept: GRASPTRACK_MODELS, or a folder in the user's cache."""
    told = os.environ.get("GRASPTRACK_MODELS")
    if told:
        return Path(told)
    cache = os.environ.get("XDG_CACHE_HOME")
    return (Path(cache) if cache else Path.home() / ".cache") / "grasptrack" / "models"


def model_path(model: Model) -> Path:
    """Where a model's file is or would be."""
    return models_folder() / f"{model.name}.onnx"


def installed_model(model: Model) -> Path:
    """The file of a model that is there.

    Raises:
        InputError: it is not; the message says how to get it.
    """
    path = model_path(model)
    if not path.is_file():
        raise InputError(
            f'model "{model.name}" ({model.megabytes:g} MB) is not here; grasptrack models get {model.name} downloads it',
            model=model.name,
        )
    return path


def download_model(model: Model, tell: Callable[[int], None] | None = None) -> Path:
    """Fetch a model, check its hash, and keep it.

    Args:
        model: from MODELS.
        tell: called with the bytes read so far.

    Raises:
        InputError: it cannot be reached, or what came is another file; nothing is kept then.
    """
    path = model_path(model)
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(path.name + ".part")
    algorithm, _, wanted = model.digest.partition(":")
    digest, read = hashlib.new(algorithm), 0
    try:
        with urllib.request.urlopen(model.url, timeout=30) as answer, part.open("wb") as file:
            while block := answer.read(_BLOCK):
                file.write(block)
                digest.update(block)
                read += len(block)
                if tell is not None:
                    tell(read)
        if digest.hexdigest() != wanted:
            raise InputError(
                f'what {model.url} gave is not model "{model.name}": its {algorithm} is {digest.hexdigest()}, not {wanted}',
                model=model.name,
            )
        part.replace(path)
    except (urllib.error.URLError, OSError, ValueError) as error:
        raise InputError(
            f'model "{model.name}" cannot be fetched from {model.url}: {error}', model=model.name
        ) from None
    finally:
        part.unlink(missing_ok=True)
    return path
