"""index.html: whole, alone, its links lead, its tables sort, and a real browser shows it as it is meant."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import replace
from html.parser import HTMLParser

import headless
import pytest

from reports import build, gallery
from reports.site.index import index, keys, lean, line, number
from reports.site.page import HERE, Page

VOID = {"area", "base", "br", "col", "hr", "img", "input", "link", "meta", "source", "wbr"}
PAGES = [replace(page, text=(HERE / page.file).read_text(encoding="utf-8")) for page in build.PAGES if (HERE / page.file).exists()]
GALLERY = (HERE / gallery.FILE).read_text(encoding="utf-8")
CARDS = gallery.cards(GALLERY)
TEXTS = [*(page.text for page in PAGES), GALLERY]
TIMES = r"/^[\d.]+\s(ns|µs|ms|s)$/"


class Reader(HTMLParser):
    """Every element with its attributes; what is not closed in its turn."""

    def __init__(self, text):
        super().__init__()
        self.elements, self.open, self.wrong = [], [], []
        self.feed(text)
        self.close()
        self.wrong += self.open

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        if tag not in VOID and (not self.open or self.open.pop() != tag):
            self.wrong.append(f"/{tag} at {self.getpos()}")

    def each(self, tag):
        return [attributes for name, attributes in self.elements if name == tag]


@pytest.fixture(scope="module")
def made():
    """The page of the committed pages, made by a function so that it can be made again."""
    return lambda: index(PAGES, build.END, build.PICTURES, CARDS)


@pytest.fixture(scope="module")
def text(made):
    return made()


@pytest.fixture(scope="module")
def read(text):
    return Reader(text)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_a_page_opens_with_three_sentences_and_ends_with_who_measured(page):
    assert len(page.opening) == 3 and all(sentence.endswith(".") for sentence in page.opening)
    assert re.search(r"\n---\n\nMade by .* measured by:\n\n(\* .*: `python -m bench.*`, .*\n)+$", page.text)


def test_the_front_page_is_read_in_a_minute():
    listed = [line for line in build.front(PAGES).splitlines() if line.startswith("* ")]
    assert len(listed) == len(PAGES) and len(" ".join(listed).split()) <= 45 * len(PAGES)  # titles and signs are words here


def test_every_element_is_closed_and_every_id_is_its_own(read):
    assert not read.wrong
    ids = [attributes["id"] for _, attributes in read.elements if "id" in attributes]
    assert [name for name, times in Counter(ids).items() if times > 1] == []
    headings = [attributes["id"] for tag, attributes in read.elements if re.fullmatch("h[2-5]", tag) and "id" in attributes]
    assert all(any(name == page.name or name.startswith(f"{page.name}-") for page in (*PAGES, *CARDS)) or name == "examples" for name in headings)


def test_it_needs_nothing_but_itself(read, text):
    loaded = [attributes[key] for _, attributes in read.elements for key in ("src", "srcset", "data", "poster") if attributes.get(key)]
    loaded += [attributes["href"] for attributes in read.each("link")]
    assert [address[:60] for address in loaded if not address.startswith("data:")] == []
    assert not re.search(r"@import|url\((?!['\"]?data:)|fetch\(|XMLHttpRequest", re.sub(r"src='[^']*'", "", text))
    assert len(text.encode()) < 7e6


def test_all_figures_of_all_pages_are_there_and_told_in_words(read):
    named = [name for page in TEXTS for name in re.findall(r"!\[[^\]]*\]\(figures/([^)]+)\)", page)]
    images = read.each("img")
    assert len(images) == len(named) + len(build.PICTURES)
    assert all(image["src"].startswith("data:image/") and len(image["src"]) > 1000 for image in images)
    assert all(image["alt"].strip() and int(image["width"]) > 0 and int(image["height"]) > 0 for image in images)
    assert "(<a" not in "".join(TEXTS)


@pytest.mark.parametrize("name", ["scenes_accuracy", "accuracy_time", "choosing_spread"])
def test_labels_keep_their_digits(name):
    def words(svg):
        return ["".join(re.sub(r"<[^>]*>", "", text).split()) for text in re.findall(r"<text[^>]*>(.*?)</text>", svg, re.S)]

    svg = (HERE / "figures" / f"{name}.svg").read_text(encoding="utf-8")
    assert words(lean(svg)) == words(svg)
    assert len(words(svg)) > 10


def test_links_within_lead_somewhere(read):
    ids = {attributes["id"] for _, attributes in read.elements if "id" in attributes}
    addresses = [attributes["href"] for attributes in read.each("a")]
    assert {f"#{page.name}" for page in (*PAGES, *CARDS)} <= set(addresses)
    assert [address for address in addresses if not (address.startswith("https://") or address[1:] in ids)] == []


def test_dead_links_are_not_built():
    page = replace(build.PAGES[0], text="# A\n\n[b](nowhere.md)")
    with pytest.raises(ValueError, match=r"quadrature\.md links to nowhere\.md"):
        index([page], "d", [])


def test_examples_have_a_part_of_their_own_once_there_are_some():
    page = replace(build.PAGES[0], text="# A\n\nB.")
    shown = Page("example-fall", lambda data: "", (), text="# A sphere falls\n\nInto oil.")
    assert "Examples" not in index([page], "d", [])
    text = index([page], "d", [], [shown])
    assert Reader(text).wrong == []
    assert "<h2 id='examples'>Examples</h2>" in text and text.count("href='#example-fall'") == 2 and '<h2 id="example-fall">A sphere falls</h2>' in text


def test_the_same_pages_give_the_same_bytes(made, text):
    assert made() == text


@pytest.mark.parametrize(
    ("cell", "before", "value"),
    [
        ("120 µs", "", 1.2e-4),
        ("2.05 ms", "", 2.05e-3),
        ("1.34 ms, 10 steps, 107 calls", "", 1.34e-3),
        ("5.02e+04 s", "", 5.02e4),
        ("1 500 ×", "", 1500),
        ("≤ 1 000 000", "", 1e6),
        ("4e-16", "", 4e-16),
        ("3.5 %", "", 0.035),
        ("8%", "", 0.08),
        ("1.06 kB", "", 1060),
        ("888 B", "", 888),
        ("−0.5 ± 0.1", "", -0.5),
        ("26 / 25.7 / 128 (9.9e-10)", "", 26),
        ("H −7.1 ± 0.1 (−25 %)", "H ", -7.1),
        ("Daitche(8)", "Daitche(", 8),
        ("100 12", "", 100),
        ("7\u00a0600\u00a0ms", "", 7.6),
    ],
)
def test_what_a_cell_sorts_by(cell, before, value):
    assert number(cell) == (before, pytest.approx(value))


def test_what_a_column_sorts_by():
    assert keys(["120 µs", "2 ms", "–", "not reached with 1 024 steps", "1 s"]) == [pytest.approx(1.2e-4), 2e-3, None, None, 1.0]
    assert keys(["rtol 1e-3", "rtol 1e-11"]) == [1e-3, 1e-11]
    assert keys(["H −7.1 ± 0.1 (−25 %)", "H +0.5", "at rest after 342 jumps", "unchanged"]) == [-7.1, 0.5, None, None]
    assert keys(["Daitche(1)", "Daitche(2)"]) == [None] * 2
    assert keys(["Exponential(1, 1e-3)", "window, tail 1e-6", "full history"]) == [None] * 3
    assert keys(["met", "missed"]) == [None] * 2


def test_formulas_read_well():
    assert line("R_p 73 falls as t^(−1/2), e^(−(t−6)²), 2^16. A power_10 of 1 000 000") == (
        "R<sub>p</sub>\u00a073 falls as t<sup>−1/2</sup>, e<sup>−(t−6)²</sup>, 2<sup>16</sup>. A power_10 of 1\u00a0000\u00a0000"
    )
    assert line("to 1e-9") == "to <span class='whole'>1e-9</span>"
    assert line("-0.5 in eqs. 5-7 and (3-6)") == "−0.5 in eqs. 5-7 and (3-6)"
    assert line("a < 3 % in 5 ms") == "a &lt; 3\u00a0% in 5\u00a0ms"


@pytest.fixture(scope="module")
def browser(text, tmp_path_factory):
    """The page in a browser, which is started once."""
    path = headless.found()
    if path is None:
        pytest.skip(f"no browser on the path: none of {', '.join(headless.NAMES)}")
    folder = tmp_path_factory.mktemp("index")
    (folder / "index.html").write_text(text, encoding="utf-8")
    try:
        running = headless.Browser(path, folder / "profile")
    except (OSError, TimeoutError) as reason:
        pytest.skip(f"{path} does not start: {reason}")
    running.address = (folder / "index.html").as_uri()
    running.open(running.address)
    yield running
    running.close()


@pytest.fixture
def shown(browser):
    """The page as it is first seen, on a desk, by day."""
    browser.window(1280, 900)
    browser.colours("light")
    browser.value("localStorage.clear(); delete document.documentElement.dataset.theme; scrollTo(0, 0)")
    return browser


def luminance(colour):
    channels = [int(part) / 255 for part in re.findall(r"\d+", colour)[:3]]
    red, green, blue = (c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels)
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue


def contrast(browser, selector):
    style = f"getComputedStyle(document.querySelector({selector!r})).color"
    bright, dark = sorted((luminance(browser.value(each)) for each in (style, "getComputedStyle(document.body).backgroundColor")), reverse=True)
    return (bright + 0.05) / (dark + 0.05)


def test_nothing_is_said_on_the_console_and_nothing_is_fetched(shown):
    shown.open(shown.address)
    kinds = ("Runtime.consoleAPICalled", "Runtime.exceptionThrown", "Log.entryAdded")
    assert [event for event in shown.events if event.get("method") in kinds] == []
    asked = {event["params"]["request"]["url"] for event in shown.events if event.get("method") == "Network.requestWillBeSent"}
    assert {address for address in asked if not address.startswith("data:")} == {shown.address}


def test_every_figure_is_drawn(shown):
    assert shown.value("Promise.all([...document.images].map(image => image.decode())).then(() => true)")
    assert shown.value("[...document.images].filter(image => !image.naturalWidth).length") == 0
    assert shown.value("[...document.images].filter(image => image.getBoundingClientRect().width > document.querySelector('main').clientWidth).length") == 0


def test_a_phone_scrolls_down_only_and_can_be_read(shown):
    shown.window(390, 844, 2.0, mobile=True)
    assert shown.value("innerWidth") == 390
    assert shown.value("document.documentElement.scrollWidth") <= 390
    sizes = shown.value("[...document.querySelectorAll('body, main p, main li, td, th, nav a')].map(e => parseFloat(getComputedStyle(e).fontSize))")
    assert sizes[0] >= 15 and min(sizes) >= 14
    assert shown.value("getComputedStyle(document.querySelector('.side')).display") == "none"
    assert shown.value("document.querySelector('.menu nav').checkVisibility()") is False
    shown.value("document.querySelector('.menu summary').click()")
    assert shown.value("document.querySelector('.menu nav').checkVisibility()") is True
    shown.value("document.querySelector('.menu nav a').click()")
    assert shown.value("document.querySelector('.menu').open") is False


def test_a_click_sorts_times_whatever_their_units(shown):
    shown.value(f"""
        const units = (table, column) => new Set([...table.tBodies[0].rows].map(row => row.cells[column].textContent.match({TIMES})?.[1]).filter(Boolean));
        for (const table of document.querySelectorAll("table"))
            [...table.tHead.rows[0].cells].forEach((head, column) => {{
                if (!window.head && units(table, column).size > 1) Object.assign(window, {{ table, head, column }});
            }});
        window.read = () => [...table.tBodies[0].rows].map(row => row.cells[column].textContent);
    """)
    given = shown.value("read()")

    def click():
        shown.value("head.querySelector('button').click()")
        cells = shown.value("read()")
        return shown.value("head.getAttribute('aria-sort')"), [number(cell)[1] for cell in cells if number(cell)], cells

    told, values, cells = click()
    assert (told, values) == ("ascending", sorted(values)) and sorted(cells) == sorted(given)
    told, values, _ = click()
    assert (told, values) == ("descending", sorted(values, reverse=True))
    assert click()[::2] == (None, given)
    shown.value("head.querySelector('button').focus()")
    shown.call("Input.dispatchKeyEvent", type="keyDown", key="Enter", code="Enter", windowsVirtualKeyCode=13, text="\r")
    assert shown.value("head.getAttribute('aria-sort')") == "ascending"


def test_search_finds_what_holds_all_words_and_leads_there(shown):
    def ask(words):
        shown.value(f"asked.value = {words!r}; asked.dispatchEvent(new Event('input'))")
        return shown.value("[...hits.querySelectorAll('a')].map(link => link.textContent)")

    assert ask("") == [] and shown.value("hits.hidden")
    assert ask("zyzzyva") == [] and shown.value("hits.textContent") == "nothing found"
    found = ask("Semi-Derivative Simpson")
    assert found and all("semi-derivative" in text.lower() or "simpson" in text.lower() or "…" in text for text in found)
    assert len(found) < len(ask("semi-derivative"))
    shown.value("scrollTo(0, 0); hits.querySelector('a').click()")
    assert shown.value("scrollY") > 0 and shown.value("hits.hidden") and shown.value("document.querySelectorAll('.sought').length") == 1


def test_dark_follows_the_system_and_the_reader(shown):
    day = shown.value("getComputedStyle(document.body).backgroundColor")
    assert contrast(shown, "body") > 7 and contrast(shown, "main a") > 4.5 and contrast(shown, ".lede") > 4.5
    shown.colours("dark")
    night = shown.value("getComputedStyle(document.body).backgroundColor")
    assert luminance(night) < 0.05 < luminance(day)
    assert contrast(shown, "body") > 7 and contrast(shown, "main a") > 4.5 and contrast(shown, ".lede") > 4.5
    shown.value("document.querySelector('.theme').click()")
    assert shown.value("getComputedStyle(document.body).backgroundColor") == day
    shown.open(shown.address)
    assert shown.value("getComputedStyle(document.body).backgroundColor") == day
    shown.value("document.querySelector('.theme').click()")
    assert shown.value("localStorage.getItem('theme')") is None


def test_paper_has_no_controls(shown):
    shown.call("Emulation.setEmulatedMedia", media="print")
    hidden = shown.value("['.bar', '.side', '.skip'].map(name => getComputedStyle(document.querySelector(name)).display)")
    shown.call("Emulation.setEmulatedMedia", media="")
    assert hidden == ["none"] * 3
