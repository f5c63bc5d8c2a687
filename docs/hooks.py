"""Pictures are the one thing that the pages take from outside of docs/.

A page links a picture as a code-hosting site needs it, `../renders/pile.png`; the built site holds a copy of it.
"""

import re
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

RENDERS = Path(__file__).parents[1] / "renders"
LINK = re.compile(r"(?:\.\./)+(renders/[\w.-]+)")


def on_files(files: Files, config: Any) -> Files:
    """Adds the pictures to what the site holds."""
    for path in sorted(RENDERS.iterdir()):
        files.append(File.generated(config, f"renders/{path.name}", abs_src_path=str(path)))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Turns links to pictures into links within the site."""
    up = "../" * page.file.src_uri.count("/")
    return LINK.sub(rf"{up}\1", markdown)
