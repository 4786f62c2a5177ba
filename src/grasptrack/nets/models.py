# SPDX-License-Identifier: Apache-2.0
"""Models that segmenters can run: what they are, where they come from, and where they are kept. None is fetched unasked.

U^2-Net (Qin et al., Pattern Recognition 106, 2020) as ONNX, from the releases of rembg; MobileSAM (Zhang et al., 2023),
exported by Acly; SAM 2 (Ravi et al., 2024), exported by samexporter. The hashes of the latter two are those that several
public projects, which have nothing to do with one another, check their downloads against.
"""

from __future__ import annotations

import hashlib
import os
import urllib.error
import urllib.request
from pathlib import Path
from typing import NamedTuple

from grasptrack.errors import InputError
from grasptrack.nets.promptable import PromptableNet
from grasptrack.nets.salient import SalientNet
from grasptrack.segmentation.segmenters import Segmenter

_REMBG = "https://github.com/danielgatis/rembg/releases/download/v0.0.0/"
_ACLY = "https://huggingface.co/Acly/MobileSAM/resolve/0d3b403339b4674a82493d5e97964dd78089ddc8/"
_SAM_2 = (
    "https://huggingface.co/vietanhdev/segment-anything-2-onnx-models/resolve/cd5a2fabd994d7b67e98d95df1232276b5cc8c0a/"
)
_BLOCK = 1 << 16
TIMEOUT_S = 30


class ModelFile(NamedTuple):
    """One file that can be downloaded; its digest has algorithm and hash, as "sha256:..."."""

    megabytes: float
    url: str
    digest: str


class NetModel(NamedTuple):
    """A net that a segmenter runs.

    Attributes:
        name: by which a segmenter is asked for.
        what: it does, in a few words.
        licence: of the weights.
        files: one, or an encoder and a decoder.
        side: px, side of the square that a net of one file takes; None of one that is asked by clicks.
        usage: nothing may stand behind its name, see `SegmenterMaker`.
    """

    name: str
    what: str
    licence: str
    files: tuple[ModelFile, ...]
    side: int | None
    usage: str = ""

    @property
    def megabytes(self) -> float:
        """Size of all files."""
        return sum(file.megabytes for file in self.files)

    def make(self, argument: str = "") -> Segmenter:
        """The segmenter."""
        files = installed_files(self)
        return SalientNet(files[0], self.side) if self.side is not None else PromptableNet(files[0], files[1])


def _model(name: str, what: str, side: int | None, folder: str, *files: tuple[float, str, str]) -> NetModel:
    """Of files in a folder of the web: MB, the name without .onnx, and the digest."""
    made = tuple(ModelFile(megabytes, f"{folder}{file}.onnx", digest) for megabytes, file, digest in files)
    return NetModel(name, what, "Apache-2.0", made, side)


U2NETP = _model(
    "u2netp",
    "salient objects, small",
    320,
    _REMBG,
    (4.6, "u2netp", "sha256:309c8469258dda742793dce0ebea8e6dd393174f89934733ecc8b14c76f4ddd8"),
)
U2NET = _model(
    "u2net",
    "salient objects, large",
    320,
    _REMBG,
    (176.0, "u2net", "md5:60024c5c889badc19c04ad937298a77b"),
)
MOBILE_SAM = _model(
    "mobile-sam",
    "asked by clicks, small",
    None,
    _ACLY,
    (28.2, "mobile_sam_image_encoder", "sha256:580f5fb648ea1062c0aabc26217aed56921985f03f0cbbd852bba81d760cc749"),
    (16.5, "sam_mask_decoder_multi", "sha256:8976b90a87ba50a6a72217a5ff994f7d25ce16f2229fcc1ed259e1294c622ffe"),
)
SAM2_TINY = _model(
    "sam2-tiny",
    "asked by clicks, large",
    None,
    _SAM_2,
    (134.3, "sam2_hiera_tiny.encoder", "sha256:4cc015ee18520e93f8c7ddfeaca7436039daaaaf19721b4b96a8810a805e82f7"),
    (20.6, "sam2_hiera_tiny.decoder", "sha256:f5a4bd656c143899fb7f52d64ed81e6f6aeb37d477a0b6da50146ac7cf2187bf"),
)
MODELS = (U2NETP, U2NET, MOBILE_SAM, SAM2_TINY)


def model_named(name: str) -> NetModel | None:
    """The model of that name, or None."""
    return next((m for m in MODELS if m.name == name), None)


def models_folder() -> Path:
    """Where models are kept: GRASPTRACK_MODELS, or a folder in the user's cache."""
    folder = os.environ.get("GRASPTRACK_MODELS")
    if folder:
        return Path(folder)
    cache = os.environ.get("XDG_CACHE_HOME")
    return (Path(cache) if cache else Path.home() / ".cache") / "grasptrack" / "models"


def model_paths(model: NetModel) -> tuple[Path, ...]:
    """Where a model's files are or would be."""
    parts = ("",) if len(model.files) == 1 else (".encoder", ".decoder")
    return tuple(models_folder() / f"{model.name}{part}.onnx" for part in parts)


def is_installed(model: NetModel) -> bool:
    """Whether all files of a model are there."""
    return all(path.is_file() for path in model_paths(model))


def installed_files(model: NetModel) -> tuple[Path, ...]:
    """The files of a model that is there."""
    if not is_installed(model):
        raise InputError(
            f'model "{model.name}" ({model.megabytes:g} MB) is not here; grasptrack models get {model.name} downloads it',
            model=model.name,
        )
    return model_paths(model)


def download_model(model: NetModel) -> tuple[Path, ...]:
    """Fetch the files of a model of MODELS, check their hashes, and keep them."""
    paths = model_paths(model)
    for file, path in zip(model.files, paths, strict=True):
        _download_file(model.name, file, path)
    return paths


def _download_file(name: str, file: ModelFile, path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(path.name + ".part")
    algorithm, _, wanted = file.digest.partition(":")
    digest = hashlib.new(algorithm)
    try:
        with urllib.request.urlopen(file.url, timeout=TIMEOUT_S) as answer, part.open("wb") as out:
            while block := answer.read(_BLOCK):
                out.write(block)
                digest.update(block)
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
