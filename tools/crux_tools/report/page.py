"""The page of a report: HTML with everything in it, no network."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass, field
from html import escape

from crux_tools.report.pictures import Picture

STYLE = """
:root {
  color-scheme: light dark;
  --text: #22303c; --quiet: #566573; --page: #f6f7f8; --sheet: white; --line: #dde2e6; --note: #fff4d6;
}
@media screen and (prefers-color-scheme: dark) {
  :root { --text: #dbe2e8; --quiet: #9aa7b3; --page: #14191e; --sheet: #1c2329; --line: #36414a; --note: #3d3320; }
  .plot img { filter: invert(0.89) hue-rotate(180deg); } /* white paper becomes the sheet; hues stay */
}
body { font: 15px/1.5 system-ui, sans-serif; color: var(--text); background: var(--page); margin: 0; }
main { max-width: 1060px; margin: 0 auto; padding: 24px; }
h1 { font-size: 26px; margin: 8px 0 0; } h2 { font-size: 18px; margin: 34px 0 8px; }
.lead { color: var(--quiet); margin: 0 0 18px; }
figure, pre { background: var(--sheet); border: 1px solid var(--line); border-radius: 6px; }
.pictures { display: grid; grid-template-columns: repeat(auto-fill, minmax(min(310px, 100%), 1fr)); gap: 12px; }
figure { margin: 0; overflow: hidden; }
.plot { overflow-x: auto; background: var(--sheet); border: 1px solid var(--line); border-radius: 6px; margin: 8px 0; }
.plot img { width: 100%; display: block; }
figure img { width: 100%; display: block; } figcaption { padding: 6px 10px; font-size: 13px; }
table { border-collapse: collapse; background: var(--sheet); width: 100%; }
th, td { text-align: left; padding: 5px 12px; border: 1px solid var(--line); vertical-align: top; }
th { font-weight: 600; width: 34%; } table.wide { margin: 8px 0; font-size: 13.5px; } .wide th { width: auto; }
.wide td:first-child { min-width: 9em; overflow-wrap: normal; }
p.note { background: var(--note); border-left: 4px solid #e8a33d; padding: 8px 12px; }
p.explain { color: var(--quiet); font-size: 13.5px; margin: 4px 0; }
p.verdict { font-size: 19px; line-height: 1.4; margin: 8px 0 14px; }
th, td { overflow-wrap: anywhere; }
pre { padding: 12px; overflow-x: auto; font-size: 13px; }
@media (max-width: 640px) {
  main { padding: 12px; } h1 { font-size: 22px; } p.verdict { font-size: 17px; }
  th, td { display: block; width: auto; border: 0; padding: 0 10px; } tr { display: block; padding: 5px 0; }
  tr + tr { border-top: 1px solid var(--line); }
  .plot { margin: 8px -12px; border-radius: 0; border-width: 1px 0; }
}
@media print { pre { white-space: pre-wrap; overflow-wrap: anywhere; } figure, .plot, tr { break-inside: avoid; } }
"""


@dataclass
class Section:
    """One heading with what stands under it."""

    id: str
    title: str
    explanation: str = ""
    verdict: str = ""
    notes: list[str] = field(default_factory=list)
    rows: Sequence[tuple[str, str]] = ()
    plots: Sequence[bytes] = ()  # PNG
    pictures: Sequence[Picture] = ()
    text: str = ""
    table: Sequence[Sequence[str]] = ()  # its head first

    def html(self) -> str:
        """The section's HTML; every word from outside is escaped."""
        parts = [f'<section id="{escape(self.id)}"><h2>{escape(self.title)}</h2>']
        if self.verdict:
            parts.append(f'<p class="verdict">{escape(self.verdict)}</p>')
        if self.explanation:
            parts.append(f'<p class="explain">{escape(self.explanation)}</p>')
        parts += [f'<p class="note">{escape(note)}</p>' for note in self.notes]
        if self.rows:
            shown = ((escape(key), escape(value).replace("\n", "<br>")) for key, value in self.rows)
            cells = "".join(f"<tr><th>{key}</th><td>{value}</td></tr>" for key, value in shown)
            parts.append(f"<table>{cells}</table>")
        if self.table:
            lines = ["".join(f"<td>{escape(cell)}</td>" for cell in line) for line in self.table]
            head = lines[0].replace("td>", "th>")
            parts.append(f'<table class="wide"><tr>{head}</tr><tr>{"</tr><tr>".join(lines[1:])}</tr></table>')
        parts += [
            f'<div class="plot"><img alt="{escape(self.title)}" src="{_data("image/png", plot)}"></div>'
            for plot in self.plots
        ]
        if self.pictures:
            figures = "".join(
                f'<figure><img alt="{escape(picture.caption)}" src="{_data("image/jpeg", picture.jpeg)}">'
                f"<figcaption>{escape(picture.caption)}</figcaption></figure>"
                for picture in self.pictures
            )
            parts.append(f'<div class="pictures">{figures}</div>')
        if self.text:
            parts.append(f"<pre>{escape(self.text)}</pre>")
        return "".join([*parts, "</section>\n"])


def _data(mime: str, content: bytes) -> str:
    return f"data:{mime};base64,{base64.b64encode(content).decode()}"


POLICY = "default-src 'none'; style-src 'unsafe-inline'; img-src data:; base-uri 'none'; form-action 'none'"


def page(title: str, lead: str, sections: Sequence[Section]) -> str:
    """The whole document, with "?" for what is no text: half a surrogate pair, which JSON can hold."""
    body = "".join(section.html() for section in sections)
    whole = (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        f'<meta http-equiv="Content-Security-Policy" content="{POLICY}">'
        f'<meta name="viewport" content="width=device-width, initial-scale=1"><title>{escape(title)}</title>'
        f"<style>{STYLE}</style></head>\n<body><main><h1>{escape(title)}</h1>"
        f'<p class="lead">{escape(lead)}</p>\n{body}</main></body></html>\n'
    )
    return whole.encode(errors="replace").decode()
