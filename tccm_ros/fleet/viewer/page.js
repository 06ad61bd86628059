"use strict";
// A row is an array in the order of `data.columns`. Only the rows in view are in the document.
const data = JSON.parse(document.getElementById("data").textContent);
const at = Object.fromEntries(data.columns.map((name, k) => [name, k]));
const ROW = 64, MARGIN = 6;

const COLUMNS = [
  { title: "", cell: picture },
  { title: "recording", key: "name", cell: nameCell },
  { title: "state", key: "state", cell: (row) => text("state", row[at.state]) },
  { title: "recorded", key: "start", cell: (row) => text("", timeText(row[at.start])) },
  { title: "duration", key: "duration", number: true, cell: (row) => number(row[at.duration], 0, " s") },
  { title: "surfaces", key: "surfaces", number: true, cell: (row) => number(row[at.surfaces]) },
  { title: "objects", key: "objects", number: true, cell: (row) => number(row[at.objects]) },
  { title: "walls", key: "walls", number: true, cell: (row) => number(row[at.walls]) },
  { title: "loops", key: "loops", number: true, cell: (row) => number(row[at.loops]) },
  { title: "dropped", key: "dropped", number: true, cell: (row) => number(row[at.dropped]) },
  { title: "replayed in", key: "seconds", number: true, cell: (row) => number(row[at.seconds], 1, " s") },
];

const byId = (id) => document.getElementById(id);
const view = { key: "name", down: false, order: [], first: -1, last: -1, draws: 0 };

function element(tag, className, content) {
  const made = document.createElement(tag);
  if (className) made.className = className;
  if (content !== undefined) made.textContent = content;
  return made;
}

const text = (className, content) => element("div", className, content);
const number = (value, digits = 0, unit = "") =>
  text("number", value === null ? "" : value.toFixed(digits) + unit);
const timeText = (stamp) =>
  stamp === null ? "" : new Date(stamp * 1000).toISOString().replace("T", " ").slice(0, 19);
const folder = (row) => `recordings/${encodeURIComponent(row[at.name])}/`;

function picture(row) {
  const box = element("div", "picture");
  if (row[at.pictures]) {
    const image = element("img");
    image.alt = `map of ${row[at.name]}`;
    image.decoding = "async";
    image.src = folder(row) + "map.png";
    box.append(image);
  }
  return box;
}

function nameCell(row) {
  const box = element("div", "name");
  const link = element(row[at.has_results] ? "a" : "span", "", row[at.name]);
  if (row[at.has_results]) link.href = folder(row) + (row[at.pictures] ? "report.html" : "");
  const source = element("small", "", row[at.source]);
  box.title = row[at.source];
  box.append(link, source);
  return box;
}

function rowElement(row) {
  const made = element("div", `row ${row[at.state]}`);
  made.setAttribute("role", "row");
  if (row[at.reason]) {
    made.append(...COLUMNS.slice(0, 3).map((column) => column.cell(row)));
    const reason = text("reason", row[at.reason]);
    reason.title = row[at.reason];
    made.append(reason);
  } else {
    made.append(...COLUMNS.map((column) => column.cell(row)));
  }
  return made;
}

// What is not known stands at the end, whichever way the rows are sorted.
function compare(a, b, key, down) {
  const [x, y] = [a[at[key]], b[at[key]]];
  if (x === null || y === null) return (x === null) - (y === null);
  const order = typeof x === "string" ? (x < y ? -1 : x > y ? 1 : 0) : x - y;
  return down ? -order : order;
}

function arrange() {
  const wanted = byId("search").value.trim().toLowerCase();
  const isFailedOnly = byId("only-failed").checked;
  view.order = data.rows.filter((row) =>
    (!isFailedOnly || row[at.state] === "failed") &&
    (!wanted || `${row[at.name]} ${row[at.source]} ${row[at.reason]}`.toLowerCase().includes(wanted)));
  view.order.sort((a, b) => compare(a, b, view.key, view.down) || compare(a, b, "name", false));
  byId("space").style.height = `${view.order.length * ROW}px`;
  byId("none").hidden = view.order.length > 0;
  view.first = -1;
  draw();
}

function draw() {
  const scroll = byId("scroll");
  const first = Math.max(0, Math.floor(scroll.scrollTop / ROW) - MARGIN);
  const last = Math.min(view.order.length, Math.ceil((scroll.scrollTop + scroll.clientHeight) / ROW) + MARGIN);
  if (first === view.first && last === view.last) return;
  [view.first, view.last] = [first, last];
  byId("rows").style.transform = `translateY(${first * ROW}px)`;
  byId("rows").replaceChildren(...view.order.slice(first, last).map(rowElement));
  view.draws += 1;
}

function head() {
  byId("head").replaceChildren(...COLUMNS.map((column) => {
    const box = element("div", column.number ? "number" : "");
    box.setAttribute("role", "columnheader");
    const button = element("button", "", column.title);
    button.disabled = !column.key;
    if (column.key) {
      button.id = `sort-${column.key}`;
      button.onclick = () => {
        view.down = view.key === column.key ? !view.down : Boolean(column.number);
        view.key = column.key;
        head();
        byId("scroll").scrollTop = 0;
        arrange();
      };
      if (view.key === column.key) box.setAttribute("aria-sort", view.down ? "descending" : "ascending");
    }
    box.append(button);
    return box;
  }));
}

const failed = data.rows.filter((row) => row[at.state] === "failed").length;
byId("counts").textContent = `${data.rows.length} recordings, ${failed} failed`;
byId("search").oninput = byId("only-failed").onchange = () => { byId("scroll").scrollTop = 0; arrange(); };
byId("scroll").onscroll = draw;
new ResizeObserver(draw).observe(byId("scroll"));
head();
arrange();
window.tccmFleet = { data, view };
