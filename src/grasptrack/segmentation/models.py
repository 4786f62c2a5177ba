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
_MOBILE_SAM = "https://huggingface.co/Acly/MobileSAM/resolve/0d3b403339b4674a82493d5e97964dd78089ddc8/"
_SAM_2 = (
    "https://huggingface.co/vietanhdev/segment-anything-2-onnx-models/resolve/cd5a2fabd994d7b67e98d95df1232276b5cc8c0a/"
)
_BLOCK = 1 << 16


class ModelFile(NamedTuple):
    """One file that can be downloaded.

    Attributes:
        megabytes: its size.
        url: where it comes from.
        digest: algorithm and hash, as "sha256:...".
    """

    megabytes: float
    url: str
    digest: str


class Model(NamedTuple):
    """A net that a segmenter runs.

    Attributes:
        name: by which a segmenter is asked for.
        what: it does, in a few words.
        licence: of the weights.
        files: one, or an encoder and a decoder.
        side: px, side of the square that a net of one file takes; None of one that is asked by clicks.
    """

    name: str
    what: str
    licence: str
    files: tuple[ModelFile, ...]
    side: int | None

    @property
    def megabytes(self) -> float:
        """Size of all files."""
        return sum(file.megabytes for file in self.files)


MODELS = (
    Model(
        "u2netp",
        "salient objects, small",
        "Apache-2.0",
        (
            ModelFile(
                4.6,
                _RELEASES + "u2netp.onnx",
                "sha256:309c8469258dda742793dce0ebea8e6dd393174f89934733ecc8b14c76f4ddd8",
            ),
        ),
        320,
    ),
    Model(
        "u2net",
        "salient objects, large",
        "Apache-2.0",
        (ModelFile(176.0, _RELEASES + "u2net.onnx", "md5:60024c5c889badc19c04ad937298a77b"),),
        320,
    ),
    Model(
        "mobile-sam",
        "asked by clicks, small",
        "Apache-2.0",
        (
            ModelFile(
                28.2,
                _MOBILE_SAM + "mobile_sam_image_encoder.onnx",
                "sha256:580f5fb648ea1062c0aabc26217aed56921985f03f0cbbd852bba81d760cc749",
            ),
            ModelFile(
                16.5,
                _MOBILE_SAM + "sam_mask_decoder_multi.onnx",
                "sha256:8976b90a87ba50a6a72217a5ff994f7d25ce16f2229fcc1ed259e1294c622ffe",
            ),
        ),
        None,
    ),
    Model(
        "sam2-tiny",
        "asked by clicks, large",
        "Apache-2.0",
        (
            ModelFile(
                134.3,
                _SAM_2 + "sam2_hiera_tiny.encoder.onnx",
                "sha256:4cc015ee18520e93f8c7ddfeaca7436039daaaaf19721b4b96a8810a805e82f7",
            ),
            ModelFile(
                20.6,
                _SAM_2 + "sam2_hiera_tiny.decoder.onnx",
                "sha256:f5a4bd656c143899fb7f52d64ed81e6f6aeb37d477a0b6da50146ac7cf2187bf",
            ),
        ),
        None,
    ),
)
"""U^2-Net (Qin et al., Pattern Recognition 106, 2020) as ONNX, from the releases of rembg; MobileSAM (Zhang et al., 2023),
exported by Acly; SAM 2 (Ravi et al., 2024), exported by samexporter. The hashes of the latter two are those that several
public projects, which have nothing to do with one another, check their downloads against."""


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


def model_paths(model: Model) -> tuple[Path, ...]:
    """Where a model's files are or would be."""
    parts = ("",) if len(model.files) == 1 else (".encoder", ".decoder")
    return tuple(models_folder() / f"{model.name}{part}.onnx" for part in parts)


def is_installed(model: Model) -> bool:
    """Whether all files of a model are there."""
    return all(path.is_file() for path in model_paths(model))


def installed_files(model: Model) -> tuple[Path, ...]:
    """The files of a model that is there.

    Raises:
        InputError: it is not; the message says how to get it.
    """
    if not is_installed(model):
        raise InputError(
            f'model "{model.name}" ({model.megabytes:g} MB) is not here; grasptrack models get {model.name} downloads it',
            model=model.name,
        )
    return model_paths(model)


def download_model(model: Model, tell: Callable[[int], None] | None = None) -> tuple[Path, ...]:
    """Fetch the files of a model, check their hashes, and keep them.

    Args:
        model: from MODELS.
        tell: called with the bytes read so far of each file.

    Raises:
        InputError: one cannot be reached, or what came is another file, which is not kept then.
    """
    paths = model_paths(model)
    for file, path in zip(model.files, paths, strict=True):
        _download(model.name, file, path, tell)
    return paths


def _download(name: str, file: ModelFile, path: Path, tell: Callable[[int], None] | None) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(path.name + ".part")
    algorithm, _, wanted = file.digest.partition(":")
    digest, read = hashlib.new(algorithm), 0
    try:
        with urllib.request.urlopen(file.url, timeout=30) as answer, part.open("wb") as out:
            while block := answer.read(_BLOCK):
                out.write(block)
                digest.update(block)
                read += len(block)
                if tell is not None:
                    tell(read)
        if digest.hexdigest() != wanted:
            raise InputError(
                f'what {file.url} gave is not model "{name}": its {algorithm} is {digest.hexdigest()}, not {wanted}',
                model=name,
            )
        part.replace(path)
    except (urllib.error.URLError, OSError, ValueError) as error:
        raise InputError(f'model "{name}" cannot be fetched from {file.url}: {error}', model=name) from None
    finally:
        part.unlink(missing_ok=True)
