"""A page as one html file that carries its own styles and scripts."""

from __future__ import annotations

from pathlib import Path

from gatjax.report.wording import escape

HERE = Path(__file__).parent
SCRIPTS = ("rays.js", "viewer.js")


def document(title: str, body: str) -> str:
    """Wrap a body into a page that carries its own styles and scripts."""
    style = (HERE / "style.css").read_text(encoding="utf-8")
    scripts = [(HERE / name).read_text(encoding="utf-8") for name in SCRIPTS]
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>gatjax: {escape(title)}</title>"
        f"<style>\n{style}</style></head>\n<body><main>{body}</main>\n"
        f"<script>\n{''.join(scripts)}</script></body></html>\n"
    )
