# SPDX-License-Identifier: Apache-2.0
"""Hooks of mkdocs: pages of the site that lie outside docs/, as they are: CONTRIBUTING.md, ros/README.md, the examples."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mkdocs.config.defaults import MkDocsConfig
    from mkdocs.structure.files import Files

ROOT = Path(__file__).resolve().parents[1]
OUTSIDE = {"CONTRIBUTING.md": "CONTRIBUTING.md", "ros/README.md": "ros-packages.md"}
"""Files of the repository, and their names on the site."""


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages from outside."""
    from mkdocs.structure.files import File, InclusionLevel

    for path, page in OUTSIDE.items():
        text = (ROOT / path).read_text(encoding="utf-8").replace("](docs/", "](")
        files.append(File.generated(config, page, content=text))
    for path in sorted((ROOT / "examples").glob("*.py")):
        code = path.read_text(encoding="utf-8")
        example = File.generated(config, f"examples/{path.stem}.md", content=f"# {path.name}\n\n```python\n{code}```\n")
        example.inclusion = InclusionLevel.NOT_IN_NAV  # pages of the docs link to them
        files.append(example)
    return files


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Lead links that leave docs/ to the pages added here."""
    for path, page in OUTSIDE.items():
        markdown = markdown.replace(f"](../{path}", f"]({page}")
    return re.sub(r"\]\(\.\./examples/(\w+)\.py\)", r"](examples/\1.md)", markdown)
