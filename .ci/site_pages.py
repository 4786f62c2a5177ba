# SPDX-License-Identifier: Apache-2.0
"""Hooks of mkdocs: pages that lie outside docs/, as they are, and a page for each package's part of the API.

From outside come CONTRIBUTING.md, ros/README.md, the examples, and the notebooks as `make site` has run them. Which public name
belongs to which package says docs/api.md.
"""

from __future__ import annotations

import base64
import json
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
NOTEBOOKS, RUN = ROOT / "examples" / "notebooks", ROOT / "build" / "notebooks"
"""Without their outputs, and with them."""
NAME = re.compile(r"\[`(\w+)`\]\(\.\./src/[\w/.]+\)")


def packages() -> dict[str, tuple[str, list[str]]]:
    """What docs/api.md says of each package, and its public names."""
    text = (ROOT / "docs" / "api.md").read_text(encoding="utf-8")
    return {package: (body.split("\n")[0], NAME.findall(body)) for package, body in SECTION.findall(text)}


def notebook_page(path: Path, run: Path) -> tuple[str, dict[str, bytes]]:
    """A notebook as Markdown, with the outputs of the same cells where they were run, and its PNGs by name."""
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    done = json.loads(run.read_text(encoding="utf-8"))["cells"] if run.exists() else []
    if [cell["source"] for cell in done] != [cell["source"] for cell in cells]:
        cells.insert(1, {"cell_type": "markdown", "source": ["*Not run here: `make site` does.*"]})
        done = cells
    parts: list[str] = []
    pictures: dict[str, bytes] = {}
    for cell in done:
        source = "".join(cell["source"]).removeprefix(
            "<!-- SPDX-License-Identifier: Apache-2.0 -->\n"
        )  # its title comes first
        parts.append(source if cell["cell_type"] == "markdown" else f"```python\n{source}\n```")
        for output in cell.get("outputs", []):
            data = output.get("data", {"text/plain": output.get("text", "")})
            if "image/png" in data:
                name = f"{path.stem}-{len(pictures) + 1}.png"
                pictures[name] = base64.b64decode("".join(data["image/png"]))
                parts.append(f"![output {len(pictures)}]({name})")
            elif told := "".join(data["text/plain"]).rstrip():
                parts.append(f'```text title="Output"\n{told}\n```')
    return "\n\n".join(parts).replace(".ipynb)", ".md)") + "\n", pictures


def on_config(config: MkDocsConfig) -> None:
    """List the packages' pages below the API's, and the notebooks after the how-to, so that one leads to the next."""
    for section in (entry for named in config.nav for entry in named.values() if isinstance(entry, list)):
        for entry in section:
            if entry.get("API") == "api.md":
                pages = [{f"grasptrack.{package}": f"api/{package}.md"} for package in packages()]
                entry["API"] = ["api.md", *pages]
    after = next(i for i, entry in enumerate(config.nav) if "How-to" in entry) + 1
    config.nav.insert(after, {"Notebooks": [f"notebooks/{path.stem}.md" for path in sorted(NOTEBOOKS.glob("*.ipynb"))]})


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages."""
    from mkdocs.structure.files import File, InclusionLevel

    def add(page: str, content: str) -> None:
        made = File.generated(config, page, content=content)
        made.inclusion = InclusionLevel.NOT_IN_NAV  # other pages link to them
        files.append(made)

    for path, page in OUTSIDE.items():
        text = (ROOT / path).read_text(encoding="utf-8").replace("](docs/", "](").replace("](../docs/", "](")
        made = File.generated(config, page, content=text)
        made.edit_uri = f"../{path}"
        files.append(made)
    examples = {path.stem: path.read_text(encoding="utf-8") for path in sorted((ROOT / "examples").glob("*.py"))}
    for stem, text in examples.items():
        add(f"examples/{stem}.md", f"# {stem}.py\n\n```python\n{text}```\n")
    for path in sorted(NOTEBOOKS.glob("*.ipynb")):
        page, pictures = notebook_page(path, RUN / path.name)
        made = File.generated(config, f"notebooks/{path.stem}.md", content=page)
        made.edit_uri = f"../examples/notebooks/{path.name}"
        files.append(made)
        for name, png in pictures.items():
            files.append(File.generated(config, f"notebooks/{name}", content=png))
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
    markdown = re.sub(r"\]\(\.\./examples/(notebooks/\w+)\.ipynb\)", r"](\1.md)", markdown)
    return re.sub(r"\]\(\.\./examples/(\w+)\.py\)", r"](examples/\1.md)", markdown)
