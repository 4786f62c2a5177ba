# SPDX-License-Identifier: Apache-2.0
"""Hooks of mkdocs: pages that lie outside docs/, as they are, and a page for each package's part of the API.

From outside come CONTRIBUTING.md, ros/README.md and the examples. Which public name belongs to which package says docs/api.md.
"""

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
SECTION = re.compile(r"^## grasptrack\.(\w+)\n\n(.*?)(?=^## |\Z)", re.MULTILINE | re.DOTALL)
NAME = re.compile(r"\[`(\w+)`\]\(\.\./src/[\w/.]+\)")


def packages() -> dict[str, tuple[str, list[str]]]:
    """What docs/api.md says of each package, and its public names."""
    text = (ROOT / "docs" / "api.md").read_text(encoding="utf-8")
    return {package: (body.split("\n")[0], NAME.findall(body)) for package, body in SECTION.findall(text)}


def on_config(config: MkDocsConfig) -> None:
    """List the packages' pages below the API's, so that one leads to the next."""
    for section in (entry for named in config.nav for entry in named.values() if isinstance(entry, list)):
        for entry in section:
            if entry.get("API") == "api.md":
                pages = [{f"grasptrack.{package}": f"api/{package}.md"} for package in packages()]
                entry["API"] = ["api.md", *pages]


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages."""
    from mkdocs.structure.files import File, InclusionLevel

    def add(page: str, content: str) -> None:
        made = File.generated(config, page, content=content)
        made.inclusion = InclusionLevel.NOT_IN_NAV  # other pages link to them
        files.append(made)

    for path, page in OUTSIDE.items():
        text = (ROOT / path).read_text(encoding="utf-8").replace("](docs/", "](")
        made = File.generated(config, page, content=text)
        made.edit_uri = f"../{path}"
        files.append(made)
    examples = {path.stem: path.read_text(encoding="utf-8") for path in sorted((ROOT / "examples").glob("*.py"))}
    for stem, text in examples.items():
        add(f"examples/{stem}.md", f"# {stem}.py\n\n```python\n{text}```\n")
    robots = sorted((ROOT / "examples" / "robots").glob("*.*"))
    shown = [f"## {path.name}\n\n```\n{path.read_text(encoding='utf-8')}```\n" for path in robots]
    add("examples/robots.md", "\n".join(["# Clients in robots' own languages\n", *shown]))
    for package, (about, names) in packages().items():
        # `grasptrack.transfer` is a package and a function: the function is named by its whole path.
        paths = [f"{package}.{name}" if name == package else name for name in names]
        listed = "\n\n".join(f"::: grasptrack.{path}" for path in paths)
        asked = re.compile(rf"\bgt\.({'|'.join(names)})\b")
        shown = [f"[{stem}.py](../examples/{stem}.md)" for stem, text in examples.items() if asked.search(text)]
        used = f"\n\nIn use: {', '.join(shown)}." if shown else ""
        add(f"api/{package}.md", f"# grasptrack.{package}\n\n{about.replace('](', '](../')}{used}\n\n{listed}\n")
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Lead links that leave docs/ to the pages added here."""
    if page.file.src_uri == "api.md":
        for package, (_about, names) in packages().items():
            for name in names:
                anchor = f"grasptrack.{package}.{name}" if name == package else f"grasptrack.{name}"
                markdown = re.sub(rf"(\[`{name}`\])\(\.\./src/[\w/.]+\)", rf"\1(api/{package}.md#{anchor})", markdown)
    for path, name in OUTSIDE.items():
        markdown = markdown.replace(f"](../{path}", f"]({name}")
    markdown = markdown.replace("](../examples/robots/)", "](examples/robots.md)")
    return re.sub(r"\]\(\.\./examples/(\w+)\.py\)", r"](examples/\1.md)", markdown)
