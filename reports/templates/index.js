"use strict";
document.documentElement.classList.add("script");

// Light or dark: the system's choice until the reader makes another. A page opened as a file may not be allowed to remember.
const root = document.documentElement;
const system = window.matchMedia("(prefers-color-scheme: dark)");
const theme = document.querySelector(".theme");
function remembered(choice) {
  try {
    if (choice === undefined) return localStorage.getItem("theme");
    if (choice) localStorage.setItem("theme", choice);
    else localStorage.removeItem("theme");
  } catch { /* then it lasts as long as the page is open */ }
  return choice ?? null;
}
function effective() {
  return root.dataset.theme ?? (system.matches ? "dark" : "light");
}
function offer() {
  const other = effective() === "dark" ? "Light" : "Dark";
  theme.textContent = other;
  theme.setAttribute("aria-label", `${other} colours`);
}
const kept = remembered();
if (kept === "light" || kept === "dark") root.dataset.theme = kept;
theme.addEventListener("click", () => {
  const wanted = effective() === "dark" ? "light" : "dark";
  const own = wanted === (system.matches ? "dark" : "light"); // back to what the system says: follow it again
  if (own) delete root.dataset.theme;
  else root.dataset.theme = wanted;
  remembered(own ? null : wanted);
  offer();
});
system.addEventListener("change", offer);
offer();
theme.hidden = false;

// Tables: a click on a column's head sorts, a second one turns the order, a third restores it. Numbers were made comparable when the page was built.
const words = new Intl.Collator("en", { numeric: true });
function compare(first, second, column, turn) {
  const [a, b] = [first.cells[column], second.cells[column]];
  const [x, y] = [a.dataset.key, b.dataset.key];
  if (x !== undefined && y !== undefined) return turn * (Number(x) - Number(y));
  if (x !== undefined || y !== undefined) return x === undefined ? 1 : -1; // what has no number comes last either way
  return turn * words.compare(a.textContent, b.textContent);
}
for (const table of document.querySelectorAll("table")) {
  const rows = table.tBodies.length ? [...table.tBodies[0].rows] : [];
  const heads = [...table.tHead.rows[0].cells];
  if (rows.length < 2) continue;
  heads.forEach((head, column) => {
    const button = document.createElement("button");
    button.type = "button";
    if (!head.textContent.trim()) button.setAttribute("aria-label", `column ${column + 1}`);
    button.append(...head.childNodes);
    head.append(button);
    button.addEventListener("click", () => {
      const next = { ascending: "descending", descending: null }[head.getAttribute("aria-sort")];
      const order = next === undefined ? "ascending" : next;
      for (const other of heads) other.removeAttribute("aria-sort");
      if (order) head.setAttribute("aria-sort", order);
      const turn = order === "descending" ? -1 : 1;
      table.tBodies[0].append(...(order ? [...rows].sort((a, b) => compare(a, b, column, turn)) : rows));
    });
  });
}

// A figure is small on a phone: a click shows it in its own size, to be scrolled in its card.
for (const figure of document.querySelectorAll("article figure")) {
  figure.addEventListener("click", () => figure.classList.toggle("large"));
}

// The contents: show the sections of the part that is read; close the small menu when it has done its work.
const menu = document.querySelector(".menu");
menu.addEventListener("click", (event) => { if (event.target.closest("a")) menu.open = false; });
document.addEventListener("keydown", (event) => { if (event.key === "Escape") menu.open = false; });
const entries = new Map([...document.querySelectorAll(".side > ul > li")].map((entry) => [entry.querySelector("a").hash.slice(1), entry]));
const seen = new IntersectionObserver((changes) => {
  for (const change of changes) {
    if (!change.isIntersecting) continue;
    for (const entry of entries.values()) entry.classList.remove("here");
    entries.get(change.target.id || change.target.getAttribute("aria-labelledby")).classList.add("here");
  }
}, { rootMargin: "-30% 0px -69% 0px" });
for (const part of document.querySelectorAll(".front, article")) seen.observe(part);

// Search: paragraphs, table rows and figures that hold all the words; each leads to itself, under the section it stands in.
const search = document.querySelector(".search");
const asked = search.querySelector("input");
const hits = search.querySelector(".found");
const plain = (text) => text.toLowerCase().replace(/[\s\u00a0]+/g, " ");
let blocks = null;
function collect() {
  const found = [];
  for (const article of document.querySelectorAll("article")) {
    let heading = null;
    for (const part of article.querySelectorAll("h2, h3, h4, p, li, tr, pre, figure")) {
      if (part.parentElement.closest("p, li, figure")) continue;
      if (/^H[234]$/.test(part.tagName)) heading = part;
      const text = part.tagName === "FIGURE" ? part.querySelector("img").alt : part.textContent;
      found.push({ part, heading, title: plain(heading?.textContent ?? ""), text, own: plain(text) });
    }
  }
  return found;
}
function excerpt(text, word) {
  const place = Math.max(0, plain(text).indexOf(word) - 40);
  return (place ? "…" : "") + text.slice(place, place + 140).trim() + (text.length > place + 140 ? "…" : "");
}
function show() {
  const sought = plain(asked.value).trim().split(" ").filter(Boolean);
  hits.hidden = !sought.length;
  hits.replaceChildren();
  if (!sought.length) return;
  blocks ??= collect();
  const all = blocks.filter(({ own, title }) => sought.every((word) => own.includes(word) || title.includes(word)) && sought.some((word) => own.includes(word)));
  const count = document.createElement("p");
  count.textContent = all.length > 40 ? `the first 40 of ${all.length}` : all.length ? `${all.length} found` : "nothing found";
  hits.append(count);
  all.sort((a, b) => /^H/.test(b.part.tagName) - /^H/.test(a.part.tagName));
  for (const { part, heading, text } of all.slice(0, 40)) {
    const link = document.createElement("a");
    link.href = `#${heading?.id ?? "top"}`;
    const above = document.createElement("strong");
    above.textContent = heading?.textContent ?? "";
    link.append(above, ...(part === heading ? [] : [document.createElement("br"), excerpt(text, sought.find((word) => plain(text).includes(word)) ?? "")]));
    link.addEventListener("click", (event) => {
      event.preventDefault();
      hits.hidden = true;
      part.scrollIntoView({ block: "center" });
      part.classList.add("sought");
      setTimeout(() => part.classList.remove("sought"), 2000);
    });
    hits.append(link);
  }
}
asked.addEventListener("input", show);
asked.addEventListener("focus", show);
document.addEventListener("click", (event) => { if (!search.contains(event.target)) hits.hidden = true; });
document.addEventListener("keydown", (event) => {
  if (event.key === "Escape") { hits.hidden = true; asked.blur(); }
  if (event.key === "/" && document.activeElement !== asked) { event.preventDefault(); asked.focus(); }
});
search.hidden = false;
