// Shows the state of a run. The server says when it changed; the state itself is fetched, drawn and kept nowhere.

import { backgroundPlot, legendMarker, responsePlot } from "./plots.js";

const $ = (id) => document.getElementById(id);
const MANY = 600; // points, from which on the squares are smaller
const IN_HALF = 18; // squares of a row that fit into half the page
const MOST_CAREFUL = 12;
let state = null, version = "", fetching = false, source = null, clockAhead_ms = 0, drawn = {};
let places = new Map(); // point -> what is known of it

function make(name, className, ...children) {
  const element = document.createElement(name);
  if (className) element.className = className;
  element.append(...children);
  return element;
}

function timeText(text) {
  const at = new Date(text), today = new Date();
  const clock = at.toLocaleTimeString([], { hour: "2-digit", minute: "2-digit", hourCycle: "h23" });
  if (at.toDateString() === today.toDateString()) return clock;
  const far = Math.abs(at - today) > 5 * 86400e3 ? { day: "numeric", month: "short" } : { weekday: "short" };
  return `${at.toLocaleDateString("en-GB", far)} ${clock}`;
}

function durationText(seconds) {
  if (seconds < 90) return `${Math.max(0, Math.round(seconds))} s`;
  if (seconds < 5400) return `${Math.round(seconds / 60)} min`;
  if (seconds < 172800) return `${Math.floor(seconds / 3600)} h ${Math.floor((seconds % 3600) / 60)} min`;
  return `${(seconds / 86400).toFixed(1)} days`;
}

const now_ms = () => Date.now() + clockAhead_ms;
const since_s = (text) => (now_ms() - Date.parse(text)) / 1000;

// The state of the run and the numbers beside it; called every second too, because time goes on.
function drawState() {
  const { state: run, progress, run: about } = state;
  const taken = (progress.done ?? 0) + (progress.doubtful ?? 0);
  $("badge").textContent = run.badge;
  $("badge").className = run.name;
  const unread = progress.finished - progress.shown;
  const reading = unread > 3 ? ` ${unread} finished points are still being read for the plots.` : "";
  $("why").textContent = why(run) + reading;
  document.title = `${Math.floor((100 * taken) / Math.max(1, progress.total))} % ${run.name} – ${about.title}`;
  const elapsed = progress.measured_s + (progress.running_since ? Math.max(0, since_s(progress.running_since)) : 0);
  const atMost = progress.at_most > progress.total ? ` (at most ${progress.at_most})` : "";
  const numbers = [["points done", [`${taken}`, make("small", "", ` of ${progress.total}${atMost}`)]]];
  for (const name of ["doubtful", "bad", "failed", "skipped"])
    if (progress[name]) numbers.push([state.words[name], [`${progress[name]}`]]);
  numbers.push(["measuring time", [durationText(elapsed)]]);
  if (progress.ends) {
    const left = -since_s(progress.ends);
    numbers.push(["left, about", [left > 0 ? durationText(left) : "a moment"]], ["end, about", [timeText(progress.ends)]]);
  } else if (run.last) numbers.push([run.over ? "ended" : "last sign of life", [timeText(run.last)]]);
  $("numbers").replaceChildren(...numbers.map(([name, value]) =>
    make("div", "", make("dt", "", name), make("dd", "", ...value))));
}

function why(run) {
  if (run.name === "dead")
    return `Its process is gone${run.last ? ` since ${timeText(run.last)}` : ""}; every finished point is kept.`;
  const silent = run.last && !run.over ? since_s(run.last) : 0;
  if (run.reason) return run.reason;
  if (run.writer === "unknown" && silent > 60)
    return `Last sign of life ${durationText(silent)} ago; whether it is still being written cannot be told from here.`;
  if (run.name !== "measuring") return "";
  const now = [...places.values()].filter((place) => place.state === "measuring");
  return now.slice(0, 2).map((p) => `point ${p.index}: ${p.about}`).join("; ") + (now.length > 2 ? "; …" : "");
}

function drawBar() {
  const { words, progress } = state;
  const kinds = ["done", "doubtful", "bad", "failed", "skipped", "measuring", "planned"].filter((kind) => progress[kind]);
  $("bar").replaceChildren(...kinds.map((kind) => {
    const part = make("i", kind);
    part.style.flexGrow = progress[kind];
    return part;
  }));
  $("bar").setAttribute("aria-label", kinds.map((kind) => `${progress[kind]} ${words[kind]}`).join(", "));
  const shown = Object.keys(words).filter((kind) => progress[kind] || ["planned", "measuring", "done"].includes(kind));
  const key = shown.map((kind) => [kind, words[kind]]);
  if ([...places.values()].some((place) => place.attempt > 1)) key.push(["done again", "corner: taken again"]);
  $("key").replaceChildren(...key.map(([kind, text]) => make("li", "", make("i", `tile ${kind}`), text)));
}

function locate() {
  places = new Map(state.points.flatMap((group) => group.rows.flatMap((row) => row.index.map((index, i) => [index,
    { index, about: row.about[i], state: row.state[i], attempt: row.attempt[i], result: row.result[i] }]))));
}

function tileClass({ state: name, attempt }) {
  return `tile ${name}${attempt > 1 ? " again" : ""}`;
}

function drawTiles() {
  const structure = JSON.stringify(state.points.map((g) => [g.title, g.rows.map((row) => [row.label, row.index])]));
  if (structure !== drawn.tiles) {
    drawn.tiles = structure;
    const longest = Math.max(0, ...state.points.flatMap((group) => group.rows.map((row) => row.index.length)));
    $("tiles").className = places.size > MANY ? "many" : longest <= IN_HALF ? "pair" : "";
    $("tiles").replaceChildren(...state.points.map(tileGroup));
  }
  for (const tile of $("tiles").querySelectorAll("button")) {
    const place = places.get(Number(tile.dataset.point)), wanted = tileClass(place);
    if (tile.className.replace(" lit", "") !== wanted) {
      tile.className = wanted;
      tile.setAttribute("aria-label", `point ${place.index}, ${state.words[place.state]}`);
    }
  }
}

function tileGroup(group) {
  const rows = group.rows.map((row) => {
    const squares = make("div", "squares", ...row.index.map((index) => {
      const tile = make("button", "");
      tile.type = "button";
      tile.dataset.point = index;
      return tile;
    }));
    return row.label ? make("div", "row", make("span", "", row.label), squares) : make("div", "row bare", squares);
  });
  return make("div", "", make("h3", "", group.title), ...rows);
}

const noteText = (note) => (note.t ? `${timeText(note.t)}, ${note.text}` : note.text);

const lastNote = (notes) => [notes.findLast((note) => note.t) ?? notes.at(-1)].filter(Boolean).map(noteText).join("");

// Points that did not go well stand in a list, so that nobody has to look for them.
function drawCareful() {
  const care = state.careful.map((index) => places.get(index));
  const items = care.slice(0, MOST_CAREFUL).map((p) => make("li", "", make("i", tileClass(p)),
    make("span", "", `point ${p.index}${p.about ? `: ${p.about}` : ""}`),
    make("span", "", lastNote(state.notes[p.index] ?? []))));
  if (care.length > MOST_CAREFUL) items.push(make("li", "", make("span"), make("span", "", `and ${care.length - MOST_CAREFUL} more`)));
  $("careful").replaceChildren(...items);
  $("care").hidden = !care.length;
}

function drawPlots(again) {
  const responses = JSON.stringify(state.responses), background = JSON.stringify(state.background);
  if (again || responses !== drawn.responses) {
    drawn.responses = responses;
    $("responses").hidden = !state.responses.length;
    $("families").replaceChildren(...state.responses.flatMap((family) => {
      const legend = make("ul", "legend", ...family.steps.map((step) =>
        make("li", "", legendMarker(step.marker, step.colour), step.label)));
      const panels = make("div", "panels", ...family.panels.map(() => make("div")));
      return [make("h3", "", family.title), legend, panels];
    }));
    $("families").querySelectorAll(".panels").forEach((panels, f) => [...panels.children].forEach((place, i) =>
      place.append(responsePlot(place.clientWidth, state.responses[f], state.responses[f].panels[i]))));
  }
  if (again || background !== drawn.background) {
    drawn.background = background;
    $("background").hidden = !state.background;
    if (!state.background) return;
    const kinds = new Map(state.background.rates.map((rate) => [rate.polarity, rate]));
    $("rates-key").replaceChildren(...[...kinds.values()].map((rate) =>
      make("li", "", legendMarker(rate.marker, rate.colour), rate.polarity.toUpperCase())));
    const place = make("div");
    $("rates").replaceChildren(place);
    place.append(backgroundPlot(place.clientWidth, state.background));
  }
}

function draw() {
  const run = state.run;
  $("title").textContent = run.title;
  const facts = [run.sensor, run.window, run.station && `station ${run.station}`, state.progress.begun &&
    `begun ${timeText(state.progress.begun)}`, run.id];
  $("facts").replaceChildren(...facts.filter(Boolean).map((fact) => make("span", "", fact)));
  $("problems").replaceChildren(...state.problems.map((text) => make("p", "problem", text)));
  locate();
  drawBar();
  drawState();
  drawCareful();
  drawTiles();
  drawPlots(false);
  $("logged").hidden = !state.log.length;
  $("log").textContent = state.log.join("\n");
  $("foot").textContent = "This page only reads; nothing on it changes the run.";
  document.body.dataset.version = version;
}

async function refresh() {
  if (fetching) return;
  fetching = true;
  try {
    const answer = await fetch("/state.json", { cache: "no-store" });
    if (!answer.ok) throw new Error((await answer.text()).trim());
    state = await answer.json();
    version = answer.headers.get("X-State-Version");
    clockAhead_ms = Date.parse(answer.headers.get("X-Server-Time")) - Date.now();
    draw();
    lost("");
  } catch (error) {
    lost(error instanceof TypeError ? "" : error.message, true);
  } finally {
    setTimeout(() => { fetching = false; if (wanted !== version) refresh(); }, 700);
  }
}

function lost(text, really = Boolean(text)) {
  $("lost").hidden = !really;
  $("lost").textContent = text || "evs-bench watch does not answer; trying again. The run itself is not concerned.";
}

let wanted = "";
function listen() {
  source?.close();
  source = new EventSource("/events");
  source.onmessage = (event) => {
    const told = JSON.parse(event.data);
    wanted = told.version;
    if (wanted !== version || !$("lost").hidden) refresh();
  };
  source.onerror = () => {
    lost("", true);
    if (source.readyState === EventSource.CLOSED) setTimeout(listen, 3000);
  };
}

// What is under the pointer, the finger or the focus: a square, or a point of a plot.
function tell(element) {
  document.querySelectorAll(".lit").forEach((lit) => lit.classList.remove("lit"));
  const index = Number(element?.dataset.point), place = element && places.get(index);
  $("tip").hidden = !place;
  if (!place) return;
  document.querySelectorAll(`[data-point="${index}"]`).forEach((same) => same.classList.add("lit"));
  const lines = [`point ${index}, ${state.words[place.state]}`, place.about, ...place.result,
    ...(state.notes[index] ?? []).map(noteText)];
  $("tip").replaceChildren(...lines.filter(Boolean).map((line) => make("p", "", line)));
  const box = element.getBoundingClientRect(), tip = $("tip").getBoundingClientRect();
  const left = Math.min(Math.max(8, box.left + box.width / 2 - tip.width / 2), innerWidth - tip.width - 8);
  const top = box.top > tip.height + 12 ? box.top - tip.height - 8 : box.bottom + 8;
  $("tip").style.left = `${left + scrollX}px`;
  $("tip").style.top = `${top + scrollY}px`;
}

for (const kind of ["pointerover", "focusin", "click"])
  document.addEventListener(kind, (event) => tell(event.target.closest("[data-point]")));
document.addEventListener("keydown", (event) => event.key === "Escape" && tell(null));
document.addEventListener("visibilitychange", () => (document.hidden ? source?.close() : listen()));
new ResizeObserver(() => state && drawPlots(true)).observe($("tiles"));
setInterval(() => state && drawState(), 1000);
listen();
