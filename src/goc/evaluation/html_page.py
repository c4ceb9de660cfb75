"""eval.html: one file that shows an evaluation, without scripts and without anything from a network."""

from html import escape
from string import Template

from goc.evaluation.error_maps import RAMP, ErrorMaps
from goc.evaluation.metric_format import METRICS, MetricFormat, summary_sentence, table_columns
from goc.evaluation.result import Evaluation, Figures, ObjectEvaluation

_TILES = ("f_score_0.05", "f_score_0.01", "accuracy", "completion", "completion_unseen", "label_accuracy", "iou")
_SCENE_TILES = ("f_score_0.05", "accuracy", "completion", "normal_consistency")

_PAGE = Template("""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">
<title>$title</title><style>
:root{color-scheme:light;--ink:#22262b;--faint:#6c7279;--line:#e3e2dc;--paper:#fafaf8;--card:#fff;--alarm:#a6402e}
*{box-sizing:border-box}
body{margin:0 auto;max-width:1180px;padding:40px 28px 64px;background:var(--paper);color:var(--ink);
font:15px/1.5 system-ui,-apple-system,"Segoe UI",Roboto,sans-serif}
h1{font-size:26px;font-weight:650;margin:0 0 4px;letter-spacing:-.01em}
h2{font-size:17px;font-weight:650;margin:44px 0 12px}
p,dl{color:var(--faint);margin:0 0 6px;max-width:80ch}code{font:13px ui-monospace,Menlo,Consolas,monospace}
.tiles{display:grid;grid-template-columns:repeat(auto-fill,minmax(132px,1fr));gap:10px;margin:24px 0 0}
.tile{background:var(--card);border:1px solid var(--line);border-radius:10px;padding:12px 14px}
.tile b{display:block;font-size:24px;font-weight:620;font-variant-numeric:tabular-nums;letter-spacing:-.02em}
.tile b small{font-size:13px;font-weight:450;color:var(--faint);letter-spacing:0}
.tile span{color:var(--faint);font-size:13px}
.wide{overflow-x:auto;background:var(--card);border:1px solid var(--line);border-radius:10px}
table{border-collapse:collapse;width:100%;font-size:13.5px;font-variant-numeric:tabular-nums}
th{font-weight:550;color:var(--faint);text-align:right;padding:9px 10px;white-space:nowrap;vertical-align:bottom}
th small{display:block;font-weight:400}
td{text-align:right;padding:7px 10px;border-top:1px solid var(--line);white-space:nowrap}
th.name,td.name{text-align:left}td.name i{font-style:normal;color:var(--faint);margin-right:7px}
tr.bad td{color:var(--alarm)}tr.mean td{font-weight:620;border-top:2px solid #cfcdc5}
tr.scene td{border-top:1px solid #cfcdc5}
.bar{background:linear-gradient(90deg,#d8e7e4 var(--f),transparent var(--f))}
.card{background:var(--card);border:1px solid var(--line);border-radius:12px;padding:16px 18px 18px;margin:0 0 16px}
.card h3{margin:0 0 2px;font-size:16px;font-weight:620}.card h3 i{font-style:normal;color:var(--faint)}
.rows{display:grid;grid-template-columns:1fr 1fr;gap:16px;margin-top:12px}
.strip{display:grid;grid-template-columns:repeat(3,1fr);gap:4px}
.strip img{width:100%;display:block;border-radius:6px}
.note{font-size:13px;color:var(--faint);margin:6px 0 0}
.legend{display:flex;align-items:center;gap:12px;margin:0 0 14px;font-size:13px;color:var(--faint)}
.legend div{width:320px}.legend .ramp{height:12px;border-radius:6px;background:linear-gradient(90deg,$ramp)}
.ticks{display:flex;position:relative;height:17px}.ticks span{position:absolute;transform:translateX(-50%)}
dl{display:grid;grid-template-columns:max-content 1fr;gap:2px 16px;font-size:13.5px;max-width:none}
dt{color:var(--ink)}dd{margin:0}
@media(max-width:760px){.rows{grid-template-columns:1fr}}
</style></head><body>
<h1>$title</h1>
<p>Run <code>$run</code> against <code>$truth</code> by protocol <b>$protocol</b>. Objects matched by $matching;
$meshes meshes. $summary_sentence</p>
<div class="tiles">$tiles</div>
<h2>Objects</h2><div class="wide"><table>$table</table></div>
<p class="note">Lengths in mm, volumes in litres. Shares (F, NC, labels, IoU, watertight) count a missing object as 0;
a mean of lengths is over the objects that have one, as the row "mean over" says. $notes</p>
$gallery
<h2>What the figures mean</h2><dl>$meanings</dl>
<h2>Settings</h2><p><code>$settings</code></p><p><code>$versions</code></p>
</body></html>
""")


def page(evaluation: Evaluation, title: str, shown: list[ErrorMaps]) -> str:
    """The page as HTML."""
    columns = table_columns(evaluation)
    settings = {**evaluation.settings}
    return _PAGE.substitute(
        title=escape(title),
        run=escape(evaluation.run),
        truth=escape(evaluation.truth),
        protocol=escape(evaluation.protocol),
        matching="id" if evaluation.matching == "ids" else "shape",
        meshes={"best": "the best", "observed": "observed", "completed": "completed"}[evaluation.meshes],
        summary_sentence=escape(summary_sentence(evaluation)),
        tiles=_tiles(evaluation),
        table=_table(evaluation, columns),
        notes=escape(_notes(evaluation)),
        ramp=",".join(f"rgb{colour} {100 * at / RAMP[-1][0]:.1f}%" for at, colour in RAMP),
        gallery=_gallery(evaluation, shown),
        meanings="".join(f"<dt>{METRICS[c].title}</dt><dd>{METRICS[c].meaning}</dd>" for c in columns),
        settings=escape(", ".join(f"{name} {value}" for name, value in settings.items())),
        versions=escape(", ".join(f"{name} {value}" for name, value in evaluation.versions.items())),
    )


def _tiles(evaluation: Evaluation) -> str:
    made = [_tile(name, evaluation.mean, "objects") for name in _TILES if name in table_columns(evaluation)]
    if evaluation.scene is not None:
        made += [_tile(name, evaluation.scene, "scene") for name in _SCENE_TILES if name in evaluation.scene]
    return "".join(made)


def _tile(name: str, figures: Figures, of: str) -> str:
    word = METRICS[name]
    value = f"{word.shown(figures[name])} <small>{word.unit}</small>"
    return f"<div class=tile><b>{value}</b><span>{word.title}, {of}</span></div>"


def _table(evaluation: Evaluation, columns: list[str]) -> str:
    head = "".join(_heading(METRICS[name]) for name in columns)
    rows = "".join(_row(id, item, columns) for id, item in evaluation.objects.items())
    mean = "".join(_cell(c, evaluation.mean.get(c)) for c in columns)
    over = "".join(f"<td>{evaluation.mean_over.get(c, 0)}</td>" for c in columns)
    scene = "".join(_cell(c, (evaluation.scene or {}).get(c)) for c in columns)
    return (
        f"<thead><tr><th class=name>object</th>{head}</tr></thead><tbody>{rows}"
        f"<tr class=mean><td class=name>mean</td>{mean}</tr><tr><td class=name>mean over</td>{over}</tr>"
        + (f"<tr class=scene><td class=name>scene</td>{scene}</tr>" if evaluation.scene is not None else "")
        + "</tbody>"
    )


def _heading(word: MetricFormat) -> str:
    return f'<th title="{escape(word.meaning)}">{word.title}<small>{word.unit}&nbsp;</small></th>'


def _row(id: int, item: ObjectEvaluation, columns: list[str]) -> str:
    state = "missing" if item.predicted is None else f"as {item.predicted}" if item.predicted != id else ""
    name = f"<i>{id}</i>{escape(item.label)}" + (f" <i>{state}</i>" if state else "")
    cells = "".join(_cell(c, item.figures.get(c)) for c in columns)
    marked = ' class="bad"' if item.predicted is None or item.skipped is not None else ""
    return f"<tr{marked}><td class=name>{name}</td>{cells}</tr>"


def _cell(name: str, value: float | None) -> str:
    text = METRICS[name].shown(value)
    if name.startswith("f_score") and value is not None:
        return f'<td class=bar style="--f:{100 * value:.0f}%">{text}</td>'
    return f"<td>{text}</td>"


def _notes(evaluation: Evaluation) -> str:
    skipped = [f"{id} ({item.skipped})" for id, item in evaluation.objects.items() if item.skipped is not None]
    words = [f"Left out of the means by the protocol: {', '.join(skipped)}."] if skipped else []
    for extra in evaluation.extra:
        label = "the room" if extra.nearest_truth == 0 else f"object {extra.nearest_truth}"
        words.append(f"Extra: {extra.predicted}, {extra.area_m2:.2f} m², mostly on {label}.")
    return " ".join(words)


def _gallery(evaluation: Evaluation, shown: list[ErrorMaps]) -> str:
    if not shown:
        return ""
    marks = [(100 * at / RAMP[-1][0], f"{1000 * at:.0f}") for at in (0.0, 0.01, 0.025, 0.05)]
    ticks = "".join(f'<span style="left:{place:.1f}%">{text}</span>' for place, text in marks)
    legend = (
        "<div class=legend>distance, mm"
        f"<div><div class=ramp></div><div class=ticks>{ticks}</div></div>"
        "cool: right at 1 cm; dark: wrong at 5 cm</div>"
    )
    return "<h2>Worst objects</h2>" + legend + "".join(_card(evaluation.objects[item.id], item) for item in shown)


def _card(item: ObjectEvaluation, shown: ErrorMaps) -> str:
    names = [name for name in ("f_score_0.05", "chamfer", "accuracy", "completion") if name in item.figures]
    facts = ", ".join(
        f"{METRICS[n].title} {METRICS[n].shown(item.figures[n])} {METRICS[n].unit}".strip() for n in names
    )
    flaw = f"; not watertight: {item.flaw}" if item.flaw is not None else ""
    strips = [
        (shown.prediction, "prediction, coloured by its distance to the truth"),
        (shown.truth, "truth, coloured by its distance to the prediction" if shown.prediction else "truth"),
    ]
    drawn = "".join(f"<div>{_strip(uris)}<p class=note>{words}</p></div>" for uris, words in strips if uris)
    missing = "" if shown.prediction else "<div><p class=note>Nothing was predicted.</p></div>"
    return (
        f"<div class=card><h3><i>{shown.id}</i> {escape(item.label)}</h3>"
        f"<p class=note>{facts}{escape(flaw)}</p><div class=rows>{missing}{drawn}</div></div>"
    )


def _fact(word: MetricFormat, value: float | None) -> str:
    return f"{word.title} {word.shown(value)} {word.unit if value is not None else ''}".strip()


def _strip(uris: list[str]) -> str:
    return "<div class=strip>" + "".join(f'<img alt="" src="{uri}">' for uri in uris) + "</div>"
