#!/usr/bin/env python3
"""A preprocessor of mdBook: makes links between files of the repository into links of the site.

The pages link to each other, and to sources, as files of the repository, so that they can be read there.
Some pages of the site are files outside of docs/, taken in by {{#include}}; their links are relative to
where they really are. A link to a file that the site shows leads to that page. A link to any other file
leads to the repository, if book.toml has its address (git-repository-url), and else becomes plain text.
"""

from __future__ import annotations

import json
import posixpath
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

DOCS = "docs"
INCLUDE = re.compile(r"^\{\{#include (\S+?)\}\}$", re.MULTILINE)
LINK = re.compile(r"(!?)\[((?:[^\[\]]|\[[^\]]*\])*)\]\(([^()\s]+)\)")
FENCE = re.compile(r"^\s*(```|~~~)")
WITH_SCHEME = re.compile(r"^[a-z][a-z0-9+.-]*:", re.IGNORECASE)


def chapters(items: list[Any]) -> Iterator[dict[str, Any]]:
    """Every chapter of the book that has a file."""
    for item in items:
        chapter = item.get("Chapter") if isinstance(item, dict) else None
        if chapter:
            if chapter["path"]:
                yield chapter
            yield from chapters(chapter["sub_items"])


def taken_in(root: Path, page: str) -> str | None:
    """The file outside of docs/ that a page shows as a whole, as a path in the repository."""
    found = INCLUDE.fullmatch((root / DOCS / page).read_text().strip())
    return posixpath.normpath(posixpath.join(DOCS, posixpath.dirname(page), found[1])) if found else None


class Site:
    """Which file of the repository is shown where."""

    def __init__(self, root: Path, pages: list[str], config: dict[str, Any]) -> None:
        own = config.get("preprocessor", {}).get("links-of-the-site", {})
        html = config.get("output", {}).get("html", {})
        self.repository = html.get("git-repository-url", "").rstrip("/")
        self.files = {page: taken_in(root, page) or f"{DOCS}/{page}" for page in pages}
        self.shown = {file: page for page, file in self.files.items()} | own.get("shown", {})

    def place(self, page: str, target: str) -> str | None:
        """Where a link of a page leads on the site; None if nowhere."""
        path, hash_mark, anchor = target.partition("#")
        here = posixpath.dirname(self.files[page])
        file = posixpath.normpath(posixpath.join(here, path))
        shown = self.shown.get(file)
        if shown is None and file.startswith(f"{DOCS}/"):
            shown = file.removeprefix(f"{DOCS}/")
        if shown is not None:
            place, mark, own_anchor = shown.partition("#")
            ending = hash_mark + anchor or mark + own_anchor
            return posixpath.relpath(place, posixpath.dirname(page) or ".") + ending
        return f"{self.repository}/blob/HEAD/{file}" if self.repository else None

    def rewrite(self, page: str, text: str) -> str:
        """A page with all its links changed, apart from those in blocks of code."""

        def changed(link: re.Match[str]) -> str:
            image, label, target = link.groups()
            if WITH_SCHEME.match(target) or target.startswith("#"):
                return link[0]
            place = self.place(page, target)
            return label if place is None else f"{image}[{label}]({place})"

        lines, in_code = [], False
        for line in text.split("\n"):
            in_code ^= bool(FENCE.match(line))
            lines.append(line if in_code else LINK.sub(changed, line))
        return "\n".join(lines)


def main() -> None:
    if sys.argv[1:2] == ["supports"]:
        return
    context, book = json.load(sys.stdin)
    items = book["items"] if "items" in book else book["sections"]
    pages = [chapter["path"] for chapter in chapters(items)]
    site = Site(Path(context["root"]).parent, pages, context["config"])
    for chapter in chapters(items):
        chapter["content"] = site.rewrite(chapter["path"], chapter["content"])
    json.dump(book, sys.stdout)


if __name__ == "__main__":
    main()
