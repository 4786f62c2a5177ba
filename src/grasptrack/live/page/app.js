// SPDX-License-Identifier: Apache-2.0
// The page: what the session shows, in words and figures, and what the buttons and keys tell it.

import { Chart } from "./charts.js";
import { Connection } from "./connection.js";
import { NUMBER_COLOURS, Picture } from "./picture.js";
import { ServoPanel } from "./servo.js";
import { Tools } from "./tools.js";

const at = (id) => document.getElementById(id);
const computed = getComputedStyle(document.body);
const style = (name) => computed.getPropertyValue(name).trim();
const percent = (p) => `${(100 * p).toFixed(p > 0.995 && p < 1 ? 1 : 0)} %`;
const ERROR_MS = 8000;
const CHARTS_MS = 100; // curves are drawn that often at most: eyes see no difference, and slow machines do
const STALE_MS = 3000; // files have an image every two seconds at least
const CHARTED = ["margin", "confidence", "guess", "latency"]; // figures that stand above their curves

let moment = null;
let showsAll = false; // candidates that are unlikely, where the first is sure
let noticed = null;
let wait = null;
let chartsWait = null;
let came = 0; // when the last image came, ms
let typed = null; // what a person types as friction, until the tracker has it; its value once it is one

// The address holds the token only until the page has its cookie: it shall not stay in the history.
if (location.search) history.replaceState(null, "", location.pathname);

const picture = new Picture(at("picture"), at("loupe"));
const charts = {
  margin: new Chart(at("margin"), { zero: true }),
  confidence: new Chart(at("confidence"), { low: 0, high: 1 }),
  latency: new Chart(at("latency"), { zero: true, peaks: false }),
};
const connection = new Connection({ onMoment, onError: (line) => say(line), onHello, onLink });
const send = (command, fields) => connection.send(command, fields);
const tools = new Tools({ picture, send, onChange: showControls });

const servo = new ServoPanel({ at, setText, say });

// --- what comes in ---

function onHello(hello) {
  tools.hover = hello.hover;
  if (hello.servo) servo.open();
  at("pause").lastChild.hidden = hello.servo; // there the space key lets the arm move
  setData("parts", hello.parts ? "many" : "");
  if (hello.parts) setButton(at("rechoose"), "Look again", "N");
  setText(at("source"), hello.source);
  noticed = null;
  Object.values(charts).forEach((each) => each.clear()); // the server tells the last images again
}

function onLink(open) {
  const link = at("link");
  link.dataset.open = open;
  link.textContent = open ? "live" : "no connection";
  showHeadline();
  servo.describe(moment, open);
  if (open && typed && typed.value !== null) send("friction", { value: typed.value }); // what was typed meanwhile
}

function onMoment(next, bitmap) {
  if (next.phase !== "choosing") {
    showsAll = false;
    picture.pointed = 0;
  }
  next.others = next.sure && !showsAll ? next.candidates.splice(1).length : 0;
  if (!moment || moment.image !== next.image || next.phase !== "tracking") came = performance.now();
  moment = next;
  tools.take(next);
  picture.show(next, bitmap);
  showHeadline();
  if (next.curves.length) chart(next.curves);
  showState();
  showPlace();
  showChoice();
  showParts();
  showControls();
  showFiles();
  servo.describe(next, at("link").dataset.open === "true");
  if (noticed !== null && next.notice.number > noticed) say(next.notice.text, next.phase === "failed" ? "error" : "note");
  noticed = next.notice.number;
}

function chart(points) {
  at("charts").hidden = false;
  for (const [margin, confidence, latency, status] of points) {
    charts.margin.add(margin, status);
    charts.confidence.add(confidence, status);
    charts.latency.add(latency, status);
  }
  chartsWait ??= setTimeout(() => {
    chartsWait = null;
    drawCharts();
  }, CHARTS_MS);
}

function drawCharts() {
  Object.values(charts).forEach((each) => each.draw(style));
}

// --- state ---

// What only the page can know: that nothing comes any more, so that what it shows is old.
function headline() {
  if (at("link").dataset.open !== "true") return { word: "OFFLINE", tone: "searching", why: "what is shown is old", remedy: "look whether grasptrack live still runs" };
  if (moment.headline.tone === "tracked" && performance.now() - came > STALE_MS)
    return { word: "NOT SURE YET", tone: "unstable", why: "no image has come for some seconds", remedy: "look whether the camera still runs" };
  return moment.headline;
}

function showHeadline() {
  if (!moment) return;
  const { word, tone, why, remedy } = headline();
  setText(at("status"), word);
  setText(at("reason"), why);
  setText(at("remedy"), remedy && `Try: ${remedy}`);
  setData("status", tone);
  if (picture.tone !== tone) {
    picture.tone = tone;
    picture.draw();
  }
  if (document.title !== `${word} – grasptrack`) document.title = `${word} – grasptrack`;
}

function showState() {
  const held = moment.paused ? "paused" : moment.phase === "ended" ? "ended" : "";
  at("paused").hidden = !held;
  setText(at("paused"), held);
  setData("phase", moment.phase);
  at("picture").title = moment.name || "";
  const told = Object.fromEntries(moment.figures.map((each) => [each[0], each]));
  const absent = [null, null, "–", ""];
  for (const [id, [, label, value, tip]] of Object.entries({ margin: told.margin || absent, confidence: told.confidence || told.guess || absent, latency: told.latency || absent })) {
    const figure = at(id).parentElement;
    setText(at(`${id}-now`), value);
    if (label) setText(figure.querySelector("span"), label);
    if (tip && figure.title !== tip) figure.title = tip;
  }
  const rest = moment.figures.filter(([key]) => at("charts").hidden || !CHARTED.includes(key));
  const keys = rest.map(([key]) => key).join();
  const list = at("figures");
  if (list.dataset.keys !== keys) {
    list.dataset.keys = keys;
    list.replaceChildren(
      ...rest.map(([, label, , tip]) => {
        const figure = element("div", { title: tip }); // it stays while its value changes: so does its tooltip
        figure.append(element("dt", { textContent: label }), element("dd"));
        return figure;
      }),
    );
  }
  rest.forEach(([, , value], i) => setText(list.children[i].lastChild, value));
}

// Of a file: how far it is played, and how fast.
function showPlace() {
  at("timeline").hidden = moment.live || moment.place === undefined || moment.count === 1;
  if (at("timeline").hidden) return;
  const [here, all] = [moment.place + 1, moment.count];
  at("place").hidden = !all;
  if (all) at("place").value = Math.min(here / all, 1);
  setText(at("place-now"), all ? `${here} of ${all}` : `${here}`);
  at("step").disabled = moment.phase !== "tracking";
  if (document.activeElement !== at("speed")) at("speed").value = String(moment.speed);
}

function showChoice() {
  const choosing = moment.phase === "choosing" && (moment.candidates.length > 0 || moment.verdict);
  at("choice").hidden = !choosing;
  if (!choosing) return;
  const key = JSON.stringify([moment.others, moment.candidates.map((c) => [c.number, c.probability, c.about])]);
  const list = at("candidates");
  if (list.dataset.key !== key) {
    list.dataset.key = key;
    list.replaceChildren(...moment.candidates.map(candidateButton), ...(moment.others ? [othersButton()] : []));
  }
  showVerdict();
}

// Every part that is followed, of which one is chosen. A button stays while its part does: a click on it is not lost.
function showParts() {
  at("parts-card").hidden = !moment.parts.length;
  const list = at("parts");
  const key = moment.parts.map(({ number }) => number).join();
  if (list.dataset.key !== key) {
    list.dataset.key = key;
    const kept = Object.fromEntries([...list.children].map((button) => [button.dataset.number, button]));
    list.replaceChildren(...moment.parts.map(({ number }) => kept[number] || partButton(number)));
  }
  moment.parts.forEach(({ number, name, status, why }, i) => {
    const button = list.children[i];
    const [disc, label, state] = button.children;
    disc.dataset.tone = status;
    setText(label, name);
    setText(state, status === "tracked" ? "" : status);
    button.title = why || status;
    button.setAttribute("aria-pressed", number === moment.chosen);
    button.setAttribute("aria-label", `Part ${number}, ${name}, ${why || status}`);
  });
}

function partButton(number) {
  const button = element("button", { type: "button" });
  button.dataset.number = number;
  button.append(element("span", { className: "number", textContent: number }), element("span"), element("small"));
  button.addEventListener("click", () => send("choose", { number }));
  return button;
}

function candidateButton(candidate) {
  const button = element("button", { type: "button" });
  const number = element("span", { className: "number", textContent: candidate.number });
  number.style.background = NUMBER_COLOURS[candidate.number - 1];
  const about = candidate.number === 1 ? "the likeliest" : candidate.about;
  button.append(number, element("small", { textContent: about }), element("span", { className: "share", textContent: percent(candidate.probability) }));
  button.setAttribute("aria-label", `Candidate ${candidate.number}, ${about}, probability ${percent(candidate.probability)}`);
  button.addEventListener("click", () => send("choose", { number: candidate.number }));
  const point = (number) => () => {
    picture.pointed = number;
    picture.draw();
  };
  for (const event of ["pointerenter", "focus"]) button.addEventListener(event, point(candidate.number));
  for (const event of ["pointerleave", "blur"]) button.addEventListener(event, point(0));
  return button;
}

function othersButton() {
  const text = `Show ${moment.others} unlikely one${moment.others === 1 ? "" : "s"}`;
  const button = element("button", { type: "button", className: "quiet", textContent: text });
  button.addEventListener("click", () => {
    showsAll = true;
    send("pause", { paused: moment.paused }); // the same moment again, with all of them
  });
  return button;
}

function showVerdict() {
  const { verdict } = moment;
  const box = at("verdict");
  const key = JSON.stringify([verdict, moment.sure]);
  if (box.dataset.key === key) return;
  box.dataset.key = key;
  box.replaceChildren();
  if (!verdict) {
    box.append(element("span", { textContent: "How well it can be tracked is being tried out …" }));
    return;
  }
  const level = element("strong", { textContent: verdict.level === "none" ? "no verdict" : verdict.level });
  level.dataset.level = moment.sure ? verdict.level : ""; // how well something else would be tracked is no good news
  const which = moment.sure || !moment.candidates.length ? "" : "If 1 is meant: ";
  box.append(level, element("span", { textContent: which + verdict.expectation }));
  if (verdict.reasons.length) {
    const list = element("ul");
    list.append(...verdict.reasons.map((reason) => element("li", { textContent: reason })));
    box.append(list);
  }
}

function showControls() {
  document.querySelectorAll("[data-tool]").forEach((button) => button.setAttribute("aria-pressed", button.dataset.tool === tools.tool));
  setText(at("hint"), tools.hint() || idleHint());
  at("whole").hidden = picture.zoom === 1;
  const tips = tools.tool === "fingertips";
  at("goal").hidden = !tips;
  setText(at("goal-lead"), `${tools.points.length} fingertip${tools.points.length === 1 ? "" : "s"} marked`);
  at("save-goal").disabled = tools.points.length < 2;
  if (!moment) return;
  const { phase } = moment;
  const wire = tools.tool === "outline" && tools.wire && tools.wire.closed;
  at("use-wire").hidden = !wire;
  const many = Boolean(document.body.dataset.parts);
  at("start").hidden = wire || many || !(phase === "choosing" || phase === "looking");
  at("start").disabled = phase === "choosing" && !(moment.result || moment.candidates.length);
  const unsure = phase === "choosing" && moment.candidates.length > 0 && !moment.sure;
  setButton(at("start"), unsure ? "Start with 1" : "Start", "Enter");
  at("pause").disabled = phase !== "tracking";
  setButton(at("pause"), moment.paused ? "Go on" : "Pause", "Space");
  const recording = moment.recording.name;
  const lost = moment.recording.dropped ? `, ${moment.recording.dropped} lost` : "";
  setButton(at("record"), recording ? `Stop · ${moment.recording.images}${lost}` : "Record", "V");
  at("record").setAttribute("aria-pressed", Boolean(recording));
  if (typed && typed.value === moment.friction) typed = null;
  if (!typed && document.activeElement !== at("friction")) at("friction").value = moment.friction;
  document.querySelectorAll("[data-fingers]").forEach((button) => button.setAttribute("aria-pressed", Number(button.dataset.fingers) === moment.fingers));
}

function idleHint() {
  if (!moment || tools.tool !== "object") return "";
  if (document.body.dataset.parts) return moment.parts.length ? "Click the part that is meant" : moment.phase === "looking" ? "Looking …" : "";
  if (moment.phase === "choosing") return moment.candidates.length ? "Click the object, or drag a box round it" : "Click the object";
  return moment.phase === "looking" ? "Looking …" : "";
}

function showFiles() {
  const key = moment.files.join();
  const list = at("files");
  if (list.dataset.key === key) return;
  list.dataset.key = key;
  list.replaceChildren(
    ...moment.files.map((name) => {
      const item = element("li");
      item.append(element("a", { href: `/files/${encodeURIComponent(name)}`, textContent: name, download: name }));
      return item;
    }),
  );
}

function say(line, kind = "error") {
  const box = at("error");
  box.textContent = line;
  box.dataset.kind = kind;
  box.hidden = false;
  clearTimeout(wait);
  wait = setTimeout(() => (box.hidden = true), ERROR_MS);
}

function element(tag, fields = {}) {
  return Object.assign(document.createElement(tag), fields);
}

function setData(name, value) {
  if (document.body.dataset[name] !== value) document.body.dataset[name] = value;
}

function setText(node, text) {
  if (node.textContent !== text) node.textContent = text;
}

function setButton(button, text, key) {
  const label = `${text} `;
  if (button.firstChild.textContent !== label) button.firstChild.textContent = label;
  if (key && button.lastChild.textContent !== key) button.lastChild.textContent = key;
}

// --- what goes out ---

const actions = {
  start: () => send("start"),
  "use-wire": () => tools.useWire(),
  pause: () => moment && moment.phase === "tracking" && send("pause", { paused: !moment.paused }),
  step: stepOn,
  rechoose: () => send("rechoose"),
  restart: () => send("restart"),
  record: () => moment && send("record", { on: !moment.recording.name }),
  "save-goal": saveGoal,
  teach: () => servo.there && send("teach"),
  anew: () => servo.there && !at("anew").disabled && send("anew"),
  whole: () => zoomBy(0),
  snapshot: saveSnapshot,
  full: () => (document.fullscreenElement ? document.exitFullscreen() : document.documentElement.requestFullscreen()).catch((error) => say(String(error))),
  "help-button": () => at("help").showModal(),
  theme: switchTheme,
};
Object.entries(actions).forEach(([id, act]) => at(id).addEventListener("click", act));
document.querySelectorAll("[data-tool]").forEach((button) => button.addEventListener("click", () => tools.select(button.dataset.tool)));
document.querySelectorAll("[data-fingers]").forEach((button) =>
  button.addEventListener("click", () => send("fingers", { count: Number(button.dataset.fingers) })),
);
at("speed").addEventListener("change", () => send("tempo", { factor: Number(at("speed").value) }));
at("friction").addEventListener("input", () => (typed = { value: null }));
at("friction").addEventListener("change", () => {
  const value = at("friction").valueAsNumber;
  typed = { value: value > 0 ? value : null };
  if (value > 0) send("friction", { value });
  else say("friction is a positive number; Esc takes back what was typed");
});
at("friction").addEventListener("keydown", (event) => {
  if (event.key !== "Escape" || !moment) return;
  typed = null;
  at("friction").value = moment.friction;
});

// Lengths that were typed outlive a page that is loaded again.
for (const id of ["opening", "beyond"]) {
  try {
    at(id).value = sessionStorage.getItem(id) ?? at(id).value;
  } catch {
    // a page in a frame may have no storage
  }
  at(id).addEventListener("input", () => {
    try {
      sessionStorage.setItem(id, at(id).value);
    } catch {
      // see above
    }
  });
}

function stepOn() {
  if (!moment || moment.live || moment.phase !== "tracking") return;
  if (!moment.paused) send("pause", { paused: true });
  send("forward");
}

function saveGoal() {
  const [opening, beyond] = [at("opening").valueAsNumber, at("beyond").valueAsNumber];
  if (!(opening > 0) || !Number.isFinite(beyond)) {
    say("the opening is a positive number of mm");
    return;
  }
  const fields = { opening_m: opening / 1000, beyond_m: beyond / 1000, symmetric: at("symmetric").checked };
  send("fingertips", { points: tools.points, ...fields });
}

// About the middle of the frame; by 0: the whole picture.
function zoomBy(factor) {
  const { left, top, width, height } = picture.canvas.getBoundingClientRect();
  if (factor) picture.zoomAt(left + width / 2, top + height / 2, factor);
  else picture.showWhole();
  showControls();
}

function saveSnapshot() {
  if (!moment || !picture.bitmap) return;
  picture.snapshot().toBlob((blob) => {
    const link = element("a", { href: URL.createObjectURL(blob), download: `grasptrack-${moment.image}.png` });
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), ERROR_MS);
  });
}

function switchTheme() {
  const root = document.documentElement;
  root.dataset.theme = root.dataset.theme === "dark" ? "light" : "dark";
  try {
    localStorage.setItem("theme", root.dataset.theme);
  } catch {
    // a page in a frame may have no storage
  }
  redraw();
}

function firstTheme() {
  let kept = null;
  try {
    kept = localStorage.getItem("theme");
  } catch {
    // see above
  }
  const dark = matchMedia("(prefers-color-scheme: dark)");
  document.documentElement.dataset.theme = kept || (dark.matches ? "dark" : "light");
  dark.addEventListener("change", (event) => {
    document.documentElement.dataset.theme = event.matches ? "dark" : "light";
    redraw();
  });
}

function redraw() {
  picture.draw();
  drawCharts();
}

const KEYS = { o: "object", x: "not", c: "contacts", w: "outline", f: "fingertips" };
const SHORT = { g: "teach", a: "anew", n: "rechoose", r: "restart", v: "record", t: "theme", "?": "help-button", " ": "pause", ".": "step", 0: "whole", p: "snapshot", l: "full" };
const ZOOMS = { "+": 1.25, "=": 1.25, "-": 0.8 };

document.addEventListener("keydown", (event) => {
  const target = event.target;
  if (at("help").open || target.matches("input, select")) return;
  const command = event.ctrlKey || event.metaKey;
  if (event.key === " " && servo.there) {
    event.preventDefault(); // not a click of the button that has the focus, either
    if (!event.repeat && !command && !at("hold").disabled) servo.press();
    return;
  }
  const letter = command ? event.key.toLowerCase() : "";
  if (letter === "y" || (letter === "z" && event.shiftKey)) {
    tools.setAgain();
    event.preventDefault();
    return;
  }
  if (event.key === "Backspace" || letter === "z") {
    tools.takeBack();
    event.preventDefault();
    return;
  }
  if (command) return;
  if (target === picture.canvas && tools.key(event)) {
    event.preventDefault();
    return;
  }
  if (target.matches("button, a") && (event.key === "Enter" || event.key === " ")) return; // they act by themselves
  const key = event.key.toLowerCase();
  if (key in KEYS) tools.select(KEYS[key]);
  else if (key in SHORT) actions[SHORT[key]]();
  else if (key in ZOOMS) zoomBy(ZOOMS[key]);
  else if (/^[1-9]$/.test(key)) {
    if (moment && (moment.phase === "choosing" || moment.parts.length)) send("choose", { number: Number(key) });
  } else if (key === "enter") {
    if (!at("use-wire").hidden) tools.useWire();
    else if (tools.drawn) tools.closeWire();
    else if (!at("start").hidden && !at("start").disabled) send("start");
  } else if (key === "escape") tools.undo();
  else return;
  event.preventDefault();
});

document.addEventListener("keyup", (event) => {
  if (event.key !== " " || !servo.there) return;
  if (!event.target.matches("input")) event.preventDefault();
  servo.release("released");
});

firstTheme();
at("full").hidden = !document.fullscreenEnabled;
setInterval(showHeadline, 500);
new ResizeObserver(redraw).observe(at("frame"));
