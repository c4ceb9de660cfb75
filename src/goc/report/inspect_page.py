"""The page of `goc inspect`: one file that shows a capture, without scripts and without anything from a network."""

import base64
import io
from collections.abc import Iterable, Sequence
from html import escape
from string import Template

import numpy as np
from jaxtyping import UInt8
from PIL import Image

from goc.capture.inspect import Inspected, Inspection
from goc.report.inspect_pictures import camera_picture, contact_sheet
from goc.report.inspect_text import facts_of, ids_words

_MOST_ROWS = 60

_PAGE = Template("""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">
<title>$title</title><style>
:root{color-scheme:light;--ink:#22262b;--faint:#6c7279;--line:#e3e2dc;--paper:#fafaf8;--card:#fff;--alarm:#a6402e}
*{box-sizing:border-box}
body{margin:0 auto;max-width:1320px;padding:40px 28px 64px;background:var(--paper);color:var(--ink);
font:15px/1.5 system-ui,-apple-system,"Segoe UI",Roboto,sans-serif}
h1{font-size:26px;font-weight:650;margin:0 0 4px;letter-spacing:-.01em}
h2{font-size:17px;font-weight:650;margin:40px 0 12px}
p{color:var(--faint);margin:0 0 6px;max-width:90ch}
.tiles{display:grid;grid-template-columns:repeat(auto-fill,minmax(150px,1fr));gap:10px;margin:24px 0 0}
.tile,.card{background:var(--card);border:1px solid var(--line);border-radius:10px;padding:12px 14px}
.tile b{display:block;font-size:19px;font-weight:620;letter-spacing:-.01em}
.tile span{color:var(--faint);font-size:13px}
.card{margin:0 0 8px}.card.contradiction{border-left:4px solid var(--alarm)}.card.doubt{border-left:4px solid #c58a1b}
.wide{overflow-x:auto;background:var(--card);border:1px solid var(--line);border-radius:10px}
table{border-collapse:collapse;width:100%;font-size:13.5px;font-variant-numeric:tabular-nums}
th{font-weight:550;color:var(--faint);text-align:left;padding:9px 12px}
td{padding:7px 12px;border-top:1px solid var(--line);vertical-align:top}
img{max-width:100%;display:block;border-radius:8px;border:1px solid var(--line)}
</style></head><body>
<h1>$title</h1>
<p>$summary</p>
<div class="tiles">$tiles</div>
<h2>Does it agree with itself?</h2>$findings
<h2>Cameras and what they see</h2><p>From above, and from one side, by the cameras' own up. $legend</p>$cameras
<h2>Damaged views</h2>$damage
<h2>Ids</h2>$ids
<h2>Views</h2>$sheet
</body></html>
""")


def inspect_page(found: Inspected) -> str:
    """The page as HTML, pictures included."""
    told = found.inspection
    return _PAGE.substitute(
        title=escape(told.path),
        summary=escape(_summary(told)),
        tiles="".join(
            f"<div class=tile><b>{escape(value)}</b><span>{escape(name)}</span></div>" for name, value in facts_of(told)
        ),
        findings=_findings(told),
        legend="Orange cameras are off their neighbours." if any(one.what == "pose" for one in told.damage) else "",
        cameras=_picture(camera_picture(found), "PNG"),
        damage=_damage(told),
        ids=_ids(told),
        sheet=_picture(contact_sheet(found), "JPEG"),
    )


def _tile(name: str, value: str) -> str:
    return f"<div class=tile><b>{escape(value)}</b><span>{escape(name)}</span></div>"


def _summary(told: Inspection) -> str:
    damaged = len({one.view for one in told.damage})
    of = "views" if told.looked_at == told.views else f"views that were looked at (of {told.views})"
    return f"{told.looked_at} {of}; {damaged} of them damaged; {len(told.findings)} findings."


def _findings(told: Inspection) -> str:
    if not told.findings:
        return "<p>Yes: no check found anything.</p>"
    return "".join(
        f'<div class="card {one.severity}"><b>{one.severity}</b>: {escape(one.message)}</div>' for one in told.findings
    )


def _damage(told: Inspection) -> str:
    rows = [(one.view, one.what, one.detail) for one in told.damage]
    return _table(("view", "what", "how much"), rows) if rows else "<p>None.</p>"


def _ids(told: Inspection) -> str:
    if not told.has_ids:
        return "<p>The capture has no ids: goc tells objects apart by their shape.</p>"
    damage = [
        (words, ", ".join(one.views[:6]) + (" …" if len(one.views) > 6 else "")) for one, words in ids_words(told)
    ]
    objects = [(str(o.id), o.name, str(o.views), f"{100 * o.largest:.2f} %") for o in told.objects]
    steady = _table(("object", "in views"), damage) if damage else "<p>No id flickers, merges or splits.</p>"
    return steady + "<p></p>" + _table(("id", "name", "views", "largest share of a view"), objects)


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    listed = list(rows)
    body = "".join(
        "<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in listed[:_MOST_ROWS]
    )
    more = f"<p>{len(listed) - _MOST_ROWS} more: see --json.</p>" if len(listed) > _MOST_ROWS else ""
    titles = "".join(f"<th>{escape(title)}</th>" for title in head)
    return f"<div class=wide><table><tr>{titles}</tr>{body}</table></div>{more}"


def _picture(pixels: UInt8[np.ndarray, "h w 3"], kind: str) -> str:
    encoded = io.BytesIO()
    Image.fromarray(pixels).save(encoded, format=kind, **({"quality": 82} if kind == "JPEG" else {}))
    data = base64.b64encode(encoded.getvalue()).decode("ascii")
    return f'<img alt="" src="data:image/{kind.lower()};base64,{data}">'
