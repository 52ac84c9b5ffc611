"""index.html: every page in one file that needs nothing else: figures inside, tables that sort, light and dark, paper."""

from __future__ import annotations

import base64
import io
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from html import escape
from itertools import count, pairwise
from pathlib import Path
from urllib.parse import urlsplit

from markdown_it import MarkdownIt
from markdown_it.token import Token
from PIL import Image

from reports.site.page import Page, Picture, fill, folder, template

BLANKS = re.compile(  # inside quantities, where no line may break: digits, units, uncertainties, symbols before their values
    r"(?<=\d) (?=\d{3}(?!\d)|[×%]|(?:ns|µs|ms|s|[kMG]?B|mm|m|d)\b)| (?=± )|(?<=±) |(?:(?<=\b[^\W\d])|(?<=_[^\W\d])) (?=[-−+]?\d)"
)
MINUS = re.compile(r"(?<![\w)])-(?=\d)")
POWERS = re.compile(r"\d(?:[\d.]*\d)?e-\d+")
LOWERED, RAISED = re.compile(r"\b([^\W\d_]{1,2})_([^\W\d_]{1,3}|∞)\b"), re.compile(r"(?<=[\w)])\^(?:\(((?:[^()]|\([^()]*\))+)\)|([-−+]?\w+(?:\.\d+)?))")


def line(text: str) -> str:
    """Text as HTML: quantities stay on one line, indices and exponents stand where they belong."""
    text = MINUS.sub("−", BLANKS.sub("\u00a0", escape(text, quote=False)))
    text = POWERS.sub(r"<span class='whole'>\g<0></span>", text)
    return RAISED.sub(lambda found: f"<sup>{found[1] or found[2]}</sup>", LOWERED.sub(r"\1<sub>\2</sub>", text))


MARKDOWN = MarkdownIt("commonmark", {"html": True}).enable("table")
MARKDOWN.add_render_rule("text", lambda _, tokens, i, *rest: line(tokens[i].content))
MARKDOWN.add_render_rule("table_open", lambda *_: "<div class='table'><table>\n")
MARKDOWN.add_render_rule("table_close", lambda *_: "</table></div>\n")
UNITS = {"ns": 1e-9, "µs": 1e-6, "ms": 1e-3, "min": 60.0, "kB": 1e3, "MB": 1e6, "GB": 1e9, "%": 1e-2}  # s, B and all others count as they are
NUMBER = re.compile(
    r"(?P<sign>[-−+]?)(?P<digits>\d{1,3}(?:[ \u00a0\u202f]\d{3})+(?!\d)|\d+)(?P<rest>(?:\.\d+)?(?:e[-+]?\d+)?)"
    r"(?:[ \u00a0]?(?P<unit>[^\W\d_]+|%))?"
)
BEFORE = re.compile(r"^[≤≥<>≈~×± ]+")
ALONE = re.compile(r"^[≤≥<>≈~×± ]*" + NUMBER.pattern + r"(?: ?×)?(?: ± [\d.]+)?$")
MISSING = ("", "–", "—", "-")


def number(cell: str) -> tuple[str, float] | None:
    """What stands before the first number of a cell, and that number in the unit that all cells share (seconds, bytes, one)."""
    text = BEFORE.sub("", cell)
    found = NUMBER.search(text)
    if not found:
        return None
    digits = re.sub(r"\s", "", found["digits"])
    return text[: found.start()], float(f"{found['sign'].replace('−', '-')}{digits}{found['rest']}") * UNITS.get(found["unit"] or "", 1.0)


def keys(cells: Sequence[str]) -> list[float | None]:
    """What sorts a column: the first numbers, if they stand first in at least half of the cells or after the same words; otherwise nothing, and text sorts."""
    found = [None if cell in MISSING else number(cell) for cell in cells]
    told = sum(cell not in MISSING for cell in cells)
    shared, times = next(iter(Counter(pair[0] for pair in found if pair).most_common(1)), ("", 0))
    if 2 * times < told or "(" in shared:  # the parameters of a scheme are no quantity
        return [None] * len(cells)
    return [pair[1] if pair and pair[0] == shared else None for pair in found]


def picture(path: Path, still: bool = False) -> str:
    """A figure as the value of src='…': SVG as text, which is sharp and smaller than in base64, everything else in base64."""
    sharp = path.with_suffix(".svg")
    if sharp.exists():
        text = re.sub(r"[%#']", lambda found: f"%{ord(found[0]):02X}", lean(sharp.read_text(encoding="utf-8")))
        return "data:image/svg+xml;charset=utf-8," + text.replace("&", "&amp;")
    content, kind = path.read_bytes(), path.suffix[1:]
    if still:
        content, kind = frame(path), "png"
    return f"data:image/{kind};base64,{base64.b64encode(content).decode()}"


def lean(svg: str) -> str:
    """An SVG without what nobody sees: prologue, metadata, comments, names without use, fonts not drawn, digits beyond a hundredth of a point, blanks."""
    svg = re.sub(r"<\?xml.*?\?>|<!DOCTYPE.*?>|<metadata>.*?</metadata>|<!--.*?-->", "", svg, flags=re.S)
    used = set(re.findall(r"#([\w.-]+)", svg))
    svg = re.sub(r' id="([^"]*)"', lambda found: found[0] if found[1] in used else "", svg)
    svg = re.sub(r"<[^>]*>", lambda tag: re.sub(r"(\.\d\d)\d+", r"\1", tag[0]), re.sub(r"\s+", " ", svg))  # never a label's
    svg = re.sub(r' d="[^"]*"', lambda found: re.sub(r" ?([A-Za-z]) ?", r"\1", found[0][4:-1]).join((' d="', '"')), svg)
    svg = re.sub(r"('DejaVu Sans'),[^;\"]*?(sans-serif)", r"\1, \2", svg)  # a dozen other fonts in every label
    svg = re.sub(r'style="[^"]*"', lambda found: re.sub(r"([:;]) ", r"\1", found[0]), svg)
    return svg.replace("> <", "><").strip()


def frame(path: Path) -> bytes:
    """The middle frame of an animation."""
    with Image.open(path) as film, io.BytesIO() as content:
        film.seek(getattr(film, "n_frames", 1) // 2)
        film.convert("RGB").quantize(64).save(content, "PNG", optimize=True)
        return content.getvalue()


def size(path: Path) -> str:
    """Width and height, which keep the place of a figure before it is drawn."""
    sharp = path.with_suffix(".svg")
    if sharp.exists():
        found = re.search(r'viewBox="0 0 ([\d.]+) ([\d.]+)"', sharp.read_text(encoding="utf-8"))
        width, height = (float(number) * 4 / 3 for number in found.groups()) if found else (800.0, 600.0)  # points to CSS pixels
    else:
        with Image.open(path) as image:
            width, height = image.size
    return f"width='{width:.0f}' height='{height:.0f}'"


def shown(path: Path, alternative: str, still: bool = False) -> str:
    """A figure's element."""
    return f"<img alt='{escape(alternative)}' {size(path)} decoding='async' src='{picture(path, still)}'>"


def walk(tokens: Sequence[Token]) -> Iterator[Token]:
    """All tokens, those inside lines too."""
    for token in tokens:
        yield token
        yield from walk(token.children or [])


def plain(line: Token) -> str:
    """The text of a line or an image without its marks."""
    return "".join(" " if token.type in ("softbreak", "html_inline") else token.content for token in walk(line.children or [])).strip()


def place(target: str, file: str, pages: Sequence[Page]) -> str | None:
    """Where a link of a page leads in index.html; None: nowhere, because what it names is a file beside the page."""
    parts = urlsplit(target)
    if parts.scheme in ("http", "https"):
        return target
    named = next((page for page in pages if page.file == (parts.path or file)), None)
    if named:
        return f"#{named.name}-{parts.fragment}" if parts.fragment else f"#{named.name}"
    if not (folder() / parts.path).exists():
        raise ValueError(f"reports/{file} links to {target}, which is neither a page nor a file beside it")
    return None


def relink(line: Token, file: str, pages: Sequence[Page]) -> None:
    """Links of a line lead to parts of index.html; those to files become text; the name of a page's file becomes its title."""
    titles = {page.file: page.title for page in pages}
    kept: list[Token] = []
    target: str | None = None
    for token in line.children or []:
        if token.type == "link_open":
            target = place(str(token.attrGet("href")), file, pages)
            token.attrSet("href", target or "")
        elif token.type == "text" and target:
            token.content = titles.get(token.content, token.content)
        if token.type not in ("link_open", "link_close") or target:
            kept.append(token)
        if token.type == "link_close":
            target = None
    line.children = kept


def heading(tokens: Sequence[Token], name: str) -> list[tuple[str, str]]:
    """Give headings ids that begin with the page's name and put them one level down; the id and title of every section."""
    sections, taken = [], Counter[str]()
    for opening, line in pairwise(tokens):
        if opening.type == "heading_open":
            level = int(opening.tag[1])
            words = re.sub(r"[^a-z0-9]+", "-", plain(line).lower()).strip("-")
            slug = name if level == 1 else f"{name}-{words}"
            taken[slug] += 1
            opening.attrSet("id", slug if taken[slug] == 1 else f"{slug}-{taken[slug]}")
            if level == 2:
                sections.append((str(opening.attrGet("id")), plain(line)))
    for token in tokens:
        if token.type in ("heading_open", "heading_close"):
            token.tag = f"h{int(token.tag[1]) + 1}"
    return sections


def sort_keys(tokens: Sequence[Token]) -> None:
    """Mark the cells of every table: what they sort by, numbers, verdicts."""
    columns: dict[int, list[tuple[Token, str]]] = {}
    column = count()
    for opening, inner in pairwise(tokens):
        if opening.type == "tr_open":
            column = count()
        elif opening.type in ("th_open", "td_open"):
            columns.setdefault(next(column), []).append((opening, plain(inner)))
        elif opening.type == "table_close":
            for (head, _), *cells in columns.values():
                mark(head, cells)
            columns = {}


def mark(head: Token, cells: Sequence[tuple[Token, str]]) -> None:
    """Mark one column."""
    told = [text for _, text in cells if text not in MISSING]
    numbers = bool(told) and all(ALONE.match(text) for text in told)
    if numbers:
        head.attrSet("class", "number")
    for (cell, text), value in zip(cells, keys([text for _, text in cells]), strict=True):
        if value is not None:
            cell.attrSet("data-key", f"{value:.6g}")
        if numbers or text in ("met", "missed"):
            cell.attrSet("class", "number" if numbers else text)


def figures(tokens: Sequence[Token]) -> list[Token]:
    """The tokens with paragraphs that are a picture made figures, and without the links to their SVG, which is what is shown."""
    kept: list[Token] = []
    for token in tokens:
        kept.append(token)
        if token.type != "paragraph_close":
            continue
        line = kept[-2]
        if re.fullmatch(r"\(\[SVG\]\(figures/\S+\.svg\)\)", line.content):
            del kept[-3:]
        elif [inner.type for inner in line.children or []] == ["image"]:
            image = (line.children or [])[0]
            kept[-3:] = [Token("html_block", "", 0, content=f"<figure>{shown(folder() / str(image.attrGet('src')), plain(image))}</figure>\n")]
    return kept


def body(text: str, file: str, pages: Sequence[Page]) -> tuple[str, list[tuple[str, str]]]:
    """A page's Markdown as HTML, and its sections."""
    tokens = figures(MARKDOWN.parse(text))
    for token in tokens:
        if token.type == "inline":
            relink(token, file, pages)
    sections = heading(tokens, file.removesuffix(".md"))
    sort_keys(tokens)
    return MARKDOWN.renderer.render(tokens, MARKDOWN.options, {}), sections


def anchor(name: str, title: str) -> str:
    """A link to a part."""
    return f"<a href='#{name}'>{escape(title)}</a>"


def pictured(picture: Picture) -> str:
    """A picture of the front page, which leads to its page."""
    image = shown(folder() / "figures" / f"{picture.figure}.png", picture.alternative, still=True)
    return f"<a href='#{picture.page}'><figure>{image}<figcaption>{escape(picture.line)}</figcaption></figure></a>"


def summary(page: Page, pages: Sequence[Page]) -> str:
    """The first sentence of a page, under its title."""
    said = "\n\n".join([page.opening[0], *([page.note] if page.note else [])])
    return f"<section>\n<h2>{anchor(page.name, page.title)}</h2>\n{body(said, page.file, pages)[0]}</section>"


def chapter(name: str, html: str) -> str:
    """A page's part."""
    return f"<article aria-labelledby='{name}'>\n{html}</article>"


def gallery(examples: Sequence[Page], pages: Sequence[Page]) -> tuple[str, str]:
    """The examples' entry in the contents and their part, both empty if there are none."""
    if not examples:
        return "", ""
    entries = "".join(f"<li>{anchor(page.name, page.title)}</li>" for page in examples)
    cards = "\n".join(f"<section>\n{body(page.text, page.file, pages)[0]}</section>" for page in examples)
    part = chapter("examples", f"<h2 id='examples'>Examples</h2>\n<div class='examples'>\n{cards}\n</div>\n")
    return f"<li>{anchor('examples', 'Examples')}<ul>{entries}</ul></li>", part


def index(pages: Sequence[Page], footer: str, pictures: Sequence[Picture], examples: Sequence[Page] = ()) -> str:
    """The whole of index.html from every page, the front page's footer and pictures, and what is in the gallery, whose page is examples.md."""
    known = [*pages, *examples, *([Page("examples", lambda data: "", (), "# Examples")] if examples else [])]
    entries, chapters = [], []
    for page in pages:
        html, sections = body(page.text, page.file, known)
        inner = "".join(f"<li>{anchor(*section)}</li>" for section in sections)
        entries.append(f"<li>{anchor(page.name, page.title)}<ul>{inner}</ul></li>")
        chapters.append(chapter(page.name, html))
    entry, part = gallery(examples, known)
    listed = "\n".join(each for each in (*entries, entry) if each)
    return fill(
        "index.html",
        style=template("index.css"),
        script=template("index.js"),
        contents=f"<ul><li>{anchor('top', 'Summary')}</li>\n{listed}</ul>",
        pictures="\n".join(map(pictured, pictures)),
        summaries="\n".join(summary(page, known) for page in pages),
        chapters="\n".join(each for each in (*chapters, part) if each),
        footer=body(footer, "README.md", known)[0],
    )
