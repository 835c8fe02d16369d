// The window of the laboratory. What it shows is the state that the server reads from files; which part of it is looked
// at stands in the address, so that a reload shows the same.
"use strict";

const SECTIONS = [
  { name: "folder", title: "Folder", steps: [] },
  { name: "photographs", title: "Photographs", steps: ["lamps", "develop", "response", "capture", "health"] },
  { name: "measure", title: "Measure", steps: ["measure"] },
  { name: "compare", title: "Compare", steps: ["relight"] },
  { name: "share", title: "Publish and keep", steps: ["publish", "export", "archive"] },
];
const TOOLS = { look: "Look", ball: "Ball", object: "Object", background: "Background", "as found": "Eraser", swap: "Swap", chart: "Chart", scale: "Scale" };
const HINTS = {
  look: "", ball: "Drag the circle, or its white handle; drag elsewhere to draw one.", object: "Paint what is object.",
  background: "Paint what is not the object.", "as found": "Takes back what was painted.",
  chart: "Click its four corners, clockwise from the brown patch.",
  scale: "Drag along a ruler, or any length that you know.",
  swap: "Choose two photographs below; their lamps are exchanged.",
};
const PROFILE = { creator: "Made by", institution: "Institution", licence: "Licence", place: "Place", contact: "Contact", camera: "Camera", lens: "Lens", lamps: "Lamps" };
const NEEDED = ["creator", "institution", "licence"];
const COLOURS = { object: "#2ea043", background: "#d03030", "as found": "#9aa0a8" };
const SVG = "http://www.w3.org/2000/svg";
const POLL_MS = 400, IDLE_MS = 4000;

let state = null, drawn = {}, chosen = null, known = null, brush = 0.03, fault = "", version = 0, dragging = false;
const $ = id => document.getElementById(id);

function h(tag, attributes = {}, ...children) {
  const svg = ["svg", "circle", "path", "line", "polyline", "g", "text", "title"].includes(tag);
  const element = svg ? document.createElementNS(SVG, tag) : document.createElement(tag);
  for (const [key, value] of Object.entries(attributes)) {
    if (key.startsWith("on")) element.addEventListener(key.slice(2), value);
    else if (value === true) element.setAttribute(key, "");
    else if (value !== false && value !== null && value !== undefined) element.setAttribute(key, value);
  }
  element.append(...children.filter(one => one !== null && one !== undefined));
  return element;
}

// --- where one looks: in the address ---
function view() {
  const kept = Object.fromEntries(new URLSearchParams(location.hash.slice(1)));
  return { section: "folder", photograph: "", shows: "photograph", tool: "look", all: "yes", ...kept };
}
function look(changes) {
  const next = { ...view(), ...changes };
  history.replaceState(null, "", "#" + new URLSearchParams(next));
  draw();
}

// --- the server ---
async function asked(path, options) {
  const answer = await fetch(path, { cache: "no-store", ...options });
  const data = await answer.json();
  return { status: answer.status, data };
}
async function refresh() {
  try {
    const { status, data } = await asked("/state");
    if (status === 200) state = data; else fault = data.error;
  } catch (error) {
    fault = "the program no longer answers: start hagoromo lab again";
  }
  draw();
}
// While a command runs only its progress is asked for; the files are looked at again when it, or one of its steps, ends.
async function heard() {
  const { step } = state.job;
  try {
    const { status, data } = await asked("/job");
    if (status !== 200 || !data || data.step !== step || data.status !== null) return await refresh();
    state.job = data;
  } catch (error) {
    return await refresh();
  }
  draw();
}
async function send(message) {
  try {
    const options = { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(message) };
    const { status, data } = await asked("/do", options);
    if (status === 409) {
      if (await agreed(data.replaces)) return await send({ ...message, replace: true });
      return false;
    }
    fault = status === 200 ? "" : data.error;
    if (status === 200) { state = data; version += 1; }
    else if (status !== 500) { const fresh = await asked("/state"); if (fresh.status === 200) state = fresh.data; }
  } catch (error) {
    fault = "the program no longer answers: start hagoromo lab again";
  }
  draw();
  return !fault;
}
function agreed(names) {
  const dialog = $("ask");
  dialog.querySelector("p").textContent = `This replaces ${names.join(", ")}, which ${names.length > 1 ? "are" : "is"} there already. What was there is lost.`;
  dialog.returnValue = "no";
  dialog.showModal();
  return new Promise(done => dialog.addEventListener("close", () => done(dialog.returnValue === "yes"), { once: true }));
}
const running = () => Boolean(state && state.job && state.job.status === null);
let wasRunning = false;
async function poll() {
  if (!dragging) await (running() ? heard() : refresh());
  if (wasRunning && !running()) finished();
  wasRunning = running();
  setTimeout(poll, running() ? POLL_MS : IDLE_MS);
}
function finished() {
  version += 1;
  const job = state.job;
  if (!job || job.status !== 0) return;
  const opens = stepOf(job.step) && stepOf(job.step).opens;
  if (job.step === "measure") look({ shows: "layer:normals" });
  else if (opens && opens.length) look({ shows: `result:${opens[0]}` });
  else draw();
}
const stepOf = name => (state.steps || []).find(one => one.name === name);
const current = () => {
  const names = state.order || state.photographs;
  return names.includes(view().photograph) ? view().photograph : names[0];
};

// --- drawing: each part only where what it shows has changed ---
function part(name, facts, make) {
  const key = JSON.stringify(facts);
  if (drawn[name] === key) return;
  drawn[name] = key;
  make();
}
function draw() {
  if (!state) return;
  const seen = view(), { job, ...still } = state, busy = running();
  part("steps", [still, seen.section, busy, current()], drawSteps);
  part("tools", [known, still.steps, still.layers, still.painted, still.by_hand, still.chart, still.corners, still.as_named, still.lamps_in_file, seen, busy, brush], drawTools);
  part("notes", [still.faults, still.advice, fault, seen.section], drawNotes);
  part("stage", [still.folder, still.photographs.length, still.circles, still.chart, still.corners, still.painted, still.mask_found, still.size, still.faults, seen, current(), version], drawStage);
  part("strip", [still.folder, still.order, still.lamps, still.photographs, current(), chosen, seen.tool, busy], drawStrip);
  part("command", [job, still.steps, seen.section], drawCommand);
}

function drawSteps() {
  const seen = view();
  const keptScroll = $("steps").scrollTop;
  $("sections").replaceChildren(...SECTIONS.map((section, number) => {
    const open = section.name === seen.section, steps = section.steps.map(stepOf).filter(Boolean);
    const mine = steps.filter(one => one.command);
    const said = sectionState(section, mine);
    const usable = section.name === "folder" || steps.length > 0;
    const head = h("button", { "aria-expanded": String(open), disabled: !usable, onclick: () => look({ section: section.name, tool: "look", shows: shownBy(section) }) },
      h("span", { class: "mark" }, said.mark || String(number + 1)), section.title, h("span", { class: `state ${said.kind}` }, said.text));
    const inside = h("div", { class: "inside" });
    if (open) inside.append(...(section.name === "folder" ? folderPanel() : section.name === "photographs" ? photographsPanel() : stepsPanel(mine)));
    return h("section", { class: `step ${open ? "open" : ""} ${said.kind}`, id: `section-${section.name}` }, h("h2", {}, head), inside);
  }));
  $("steps").scrollTop = keptScroll;
}
function sectionState(section, steps) {
  if (section.name === "folder") return state.photographs.length ? { kind: "done", mark: "✓", text: `${state.photographs.length} photographs` } : { kind: "", text: "" };
  if (!steps.length) return { kind: "", text: "" };
  if (section.name === "share") {
    const done = steps.filter(one => one.state === "done").length, old = steps.some(one => one.state === "out of date");
    return old ? { kind: "old", text: "out of date" } : done ? { kind: "done", mark: "✓", text: `${done} of ${steps.length}` } : { kind: "", text: "" };
  }
  const last = steps[steps.length - 1].state;
  if (last === "done") {
    const doubts = section.name === "photographs" ? state.health.filter(one => one.state === "doubtful").length : 0;
    return doubts ? { kind: "old", mark: "!", text: `${doubts} doubtful` } : { kind: "done", mark: "✓", text: "done" };
  }
  return last === "out of date" ? { kind: "old", text: "out of date" } : { kind: "", text: "" };
}
function shownBy(section) {
  const opens = section.steps.map(stepOf).filter(one => one && one.opens.length && one.state !== "to do").flatMap(one => one.opens);
  if (section.name === "measure" && state.layers && state.layers.length) return "layer:normals";
  return ["compare", "share"].includes(section.name) && opens.length ? `result:${opens[0]}` : "photograph";
}

function folderPanel() {
  const up = state.folder === "." ? null : state.folder.split("/").slice(0, -1).join("/") || ".";
  const into = name => state.folder === "." ? name : `${state.folder}/${name}`;
  const go = folder => send({ do: "open", folder }).then(done => done && look({ photograph: "", shows: "photograph" }));
  const rows = state.folders.map(name => h("li", {}, h("button", { onclick: () => go(into(name)), disabled: running() }, name)));
  return [
    h("p", {}, "Choose the folder with the photographs of one object: one place, one lamp on in each."),
    h("p", { class: "path" }, state.path),
    up === null ? null : h("div", { class: "row" }, h("button", { onclick: () => go(up), disabled: running() }, "↑ Folder above")),
    rows.length ? h("ul", { class: "folders" }, ...rows) : null,
    state.photographs.length ? h("button", { class: "go", id: "next", onclick: () => look({ section: "photographs" }) }, `Go on with these ${state.photographs.length} photographs`) : null,
  ].filter(Boolean);
}

function photographsPanel() {
  const idle = step => ["develop", "response"].includes(step.name) && !step.command;  // without a chart: only which one
  const rows = step => step.options.filter(one => !idle(step) || one.name === "chart" && Object.keys(one.choices).length > 1).map(one => optionRow(step, one));
  const steps = SECTIONS[1].steps.map(stepOf).filter(Boolean);
  const options = steps.flatMap(step => rows({ ...step, options: step.options.filter(one => !one.aside) }));
  const aside = steps.flatMap(step => step.options.filter(one => one.aside).map(one => [step, one]));
  options.push(h("details", { open: aside.some(([, one]) => one.value) }, h("summary", {}, "What the files do not state"), h("div", { class: "aside" }, ...aside.map(pair => optionRow(...pair)))));
  const health = stepOf("health");
  return [...options, runButton(health, "Check the photographs"), dome(), healthBox()].filter(Boolean);
}
function stepsPanel(steps) {
  return steps.flatMap((step, number) => [
    number ? h("hr") : null,
    steps.length > 1 || step.title !== "Measure" ? h("h3", {}, step.title, h("span", { class: `state ${step.state === "done" ? "done" : step.state === "out of date" ? "old" : ""}` }, step.state === "to do" ? "" : step.state)) : null,
    h("p", {}, step.does),
    ...step.options.map(one => optionRow(step, one)),
    step.name === "archive" ? profilePanel() : null,
    h("div", { class: "row" }, runButton(step, step.name === "relight" ? "Compare" : step.title),
      ...(step.state === "to do" ? [] : step.opens.map(name => h("button", { onclick: () => look({ shows: `result:${name}` }) }, step.name === "publish" ? "Show" : "Report"))),
      step.state === "to do" || step.opens.length ? null : h("span", { class: "path" }, `in ${step.makes}`)),
  ]).filter(Boolean);
}
function runButton(step, title) {
  return h("button", { class: "go", id: `run-${step.name}`, disabled: running(), title: step.command, onclick: () => send({ do: "run", step: step.name }).then(poked) }, title);
}
function poked() { wasRunning = running(); setTimeout(refresh, 50); }
function optionRow(step, option) {
  const choose = value => send({ do: "choose", step: step.name, option: option.name, value });
  const id = `${step.name}-${option.name}`, off = running();
  if (option.many) {
    const taken = option.value.split(" ").filter(Boolean);
    const box = value => h("input", { type: "checkbox", id: `${id}-${value}`, checked: taken.includes(value), disabled: off, onchange: event => choose(Object.keys(option.choices).filter(one => one === value ? event.target.checked : taken.includes(one)).join(" ")) });
    return h("fieldset", {}, h("legend", {}, option.label), ...Object.entries(option.choices).map(([value, label]) => h("label", {}, box(value), " ", label)));
  }
  const input = option.choices
    ? h("select", { id, disabled: off, onchange: event => choose(event.target.value) }, ...Object.entries(option.choices).map(([value, label]) => h("option", { value, selected: value === option.value }, label)))
    : h("input", { id, value: option.value, placeholder: option.hint, disabled: off, maxlength: 500, onchange: event => choose(event.target.value) });
  return h("label", { class: "choice" }, h("span", {}, option.label), input);
}
function profilePanel() {
  const kept = { ...state.profile };
  const rows = Object.entries(PROFILE).map(([key, label]) => h("label", { class: "choice" }, h("span", {}, label), h("input", {
    id: `profile-${key}`, value: kept[key] || "", placeholder: NEEDED.includes(key) ? "needed, unless you have a profile" : "", disabled: running(), maxlength: 500,
    onchange: event => { kept[key] = event.target.value; send({ do: "profile", values: kept }); },
  })));
  return h("details", { open: true }, h("summary", {}, "Who, where, with what"), h("div", { class: "aside" }, ...rows));
}
function dome() {
  if (!state.lamps.length) return null;
  const svg = h("svg", { viewBox: "-110 -110 220 220", role: "img", "aria-label": "Directions of the lamps, seen from the camera" });
  for (const angle of [30, 60, 90]) svg.append(h("circle", { r: angle / 0.9, fill: "none", stroke: "#cfd3d8", "stroke-width": angle === 90 ? 1.5 : 1 }));
  svg.append(h("line", { x1: -100, x2: 100, y1: 0, y2: 0, stroke: "#e3e6e9" }), h("line", { y1: -100, y2: 100, x1: 0, x2: 0, stroke: "#e3e6e9" }));
  state.lamps.forEach((to, k) => {
    const [x, y] = onDome(to), name = state.order[k], own = name === current();
    svg.append(h("circle", { class: "lamp", cx: 100 * x, cy: -100 * y, r: own ? 7 : 4.5, fill: own ? "#e08a00" : "#1f5f8b", stroke: "#fff", "stroke-width": 1, onclick: () => look({ photograph: name, shows: "photograph" }) }, h("title", {}, `${k + 1}: ${name}`)));
  });
  const [x, y, z] = state.lamps[state.order.indexOf(current())] || [0, 0, 1];
  const up = Math.round(Math.asin(Math.max(-1, Math.min(1, z))) * 180 / Math.PI);
  return h("div", { class: "dome" }, svg, h("div", {}, h("strong", {}, `${state.lamps.length} lamps`), h("br"), "as seen from the camera; rings at 30°, 60° and 90° from it.", h("br"), `Orange: ${current()}, ${up}° above the table.`));
}
function onDome([x, y, z]) {
  const away = Math.acos(Math.max(-1, Math.min(1, z))) / (Math.PI / 2), across = Math.hypot(x, y) || 1;
  return [away * x / across, away * y / across];
}
function healthBox() {
  if (!state.health.length) return null;
  const step = stepOf("health"), old = step && step.state === "out of date";
  const mark = { good: "✓ good", doubtful: "! doubtful", "not testable": "– not testable" }, kind = { good: "good", doubtful: "doubtful", "not testable": "untested" };
  const rows = state.health.map(one => h("tr", {}, h("th", {}, one.name), h("td", {},
    h("details", { open: one.state === "doubtful" }, h("summary", { class: kind[one.state] }, mark[one.state]), h("p", {}, one.said), one.advice ? h("p", {}, h("strong", {}, one.advice)) : null))));
  return h("div", { id: "health" }, h("h3", {}, "Health of the photographs", h("span", { class: `state ${old ? "old" : ""}` }, old ? "out of date" : "")), h("table", { class: "health" }, h("tbody", {}, ...rows)));
}

// --- tools ---
function drawTools() {
  const seen = view(), tools = $("tools"), off = running();
  const made = [];
  if (state.steps && seen.section === "photographs") {
    for (const [name, label] of Object.entries(TOOLS)) {
      if (name === "swap" && !state.lamps_in_file) continue;
      if (name === "ball" && state.lamps_in_file) continue;
      if (name === "chart" && !state.chart) continue;
      made.push(h("button", { id: `tool-${name.replace(" ", "-")}`, "aria-pressed": String(seen.tool === name), disabled: off && name !== "look", title: HINTS[name], onclick: () => { chosen = known = null; look({ tool: name, shows: "photograph" }); } }, label));
      if (name === "look" || name === "as found") made.push(h("span", { class: "gap" }));
    }
    if (["object", "background", "as found"].includes(seen.tool)) {
      made.push(h("label", {}, "Brush", h("input", { type: "range", id: "brush", min: 0.004, max: 0.15, step: 0.002, value: brush, oninput: event => { brush = Number(event.target.value); } })));
      if (state.painted) made.push(h("button", { id: "clear", disabled: off, onclick: () => send({ do: "clear mask" }) }, "Clear all paint"));
    }
    if (seen.tool === "swap") made.push(h("button", { id: "reverse", disabled: off, onclick: () => send({ do: "reverse" }) }, "Reverse all"),
      state.as_named ? null : h("button", { id: "as-named", disabled: off, onclick: () => send({ do: "as named" }) }, "Order as named"));
    if (seen.tool === "scale") made.push(...lengthTools(off));
    if (seen.tool === "chart" && state.corners.length) made.push(h("button", { id: "find-corners", disabled: off, onclick: () => send({ do: "corners", corners: [] }) }, "Find them instead"));
    if (seen.tool === "ball") made.push(h("button", { id: "all", "aria-pressed": String(seen.all === "yes"), title: "The brightest of all photographs at each pixel, lifted out of the dark", onclick: () => look({ all: seen.all === "yes" ? "no" : "yes" }) }, "All in one"));
    if (seen.tool === "ball" && state.by_hand) made.push(h("button", { id: "find-balls", disabled: off, onclick: () => send({ do: "circles", circles: [] }) }, "Find it again"));
  } else if (state.steps) {
    const chip = (shows, label) => h("button", { "aria-pressed": String(seen.shows === shows), onclick: () => look({ shows }) }, label);
    if (seen.section !== "folder") made.push(chip("photograph", "Photograph"));
    if (seen.section === "measure") made.push(...state.layers.map(name => chip(`layer:${name}`, name.replace(/^[a-z]/, letter => letter.toUpperCase()))));
    for (const step of SECTIONS.find(one => one.name === seen.section).steps.map(stepOf).filter(Boolean))
      if (step.state !== "to do") made.push(...step.opens.map(name => chip(`result:${name}`, step.name === "publish" ? "Page" : "Report")));
  }
  tools.replaceChildren(...made.filter(Boolean));
}
// A known length across the photograph gives what its longer side shows: the width that `measure` takes.
function lengthTools(off) {
  const measure = stepOf("measure"), stated = measure && measure.options.find(one => one.name === "across").value;
  const take = async event => {
    const mm = Number(event.target.value), px = Math.hypot(known[2] - known[0], known[3] - known[1]);
    if (!(mm > 0)) return;
    const across = (1e-3 * mm * Math.max(...state.size) / px).toPrecision(4);
    if (await send({ do: "choose", step: "measure", option: "across", value: String(Number(across)) })) send({ do: "choose", step: "measure", option: "distance", value: "" });
  };
  return [known ? h("label", {}, "It is", h("input", { id: "length", size: 6, disabled: off, onchange: take }), "mm long") : null,
    stated ? h("span", { id: "across" }, `The longer side shows ${Number((1e3 * stated).toPrecision(4))} mm`) : null];
}
function drawNotes() {
  const lines = [fault, ...state.faults].filter(Boolean).map(text => h("li", { class: "wrong" }, text));
  if (state.photographs.length && ["folder", "photographs"].includes(view().section)) lines.push(...state.advice.map(text => h("li", {}, text)));
  $("notes").replaceChildren(...lines);
}

// --- the picture ---
function drawStage() {
  const stage = $("stage"), seen = view();
  const named = $("named");
  named.textContent = "";
  if (!state.photographs.length) return stage.replaceChildren(h("p", { class: "empty" }, state.advice[0] || ""));
  if (seen.shows.startsWith("result:")) {
    const path = seen.shows.slice(7).split("/").map(encodeURIComponent).join("/");
    named.replaceChildren(h("a", { href: `/result/${path}`, target: "_blank", rel: "noopener" }, "Open in a tab of its own"));
    return stage.replaceChildren(h("iframe", { src: `/result/${path}?${version}`, title: "Result", sandbox: "allow-scripts" }));
  }
  if (!state.size) return stage.replaceChildren(h("p", { class: "empty" }, "The photographs cannot be read: see above."));
  if (seen.shows.startsWith("layer:")) {
    const name = seen.shows.slice(6);
    if (!state.layers.includes(name)) return stage.replaceChildren(h("p", { class: "empty" }, "Not measured yet."));
    named.textContent = name;
    return stage.replaceChildren(framed(state.maps_size, `/layer?${new URLSearchParams({ name, version })}`));
  }
  const onBall = seen.tool === "ball" && state.ball_size, photographs = onBall ? state.ball_photographs : state.order;
  const name = onBall ? photographs[Math.max(state.order.indexOf(current()), 0)] || photographs[0] : current();
  const size = onBall ? state.ball_size : state.size;
  named.textContent = HINTS[seen.tool] || `${name} · ${photographs.indexOf(name) + 1} of ${photographs.length} · ${size[0]} × ${size[1]} px`;
  if (seen.tool === "chart" && state.chart_size) {
    named.textContent = HINTS.chart;
    const chart = framed(state.chart_size, `/photograph?${new URLSearchParams({ name: state.chart, size: "large" })}`);
    chart.append(cornersOf(state.chart_size));
    return stage.replaceChildren(chart);
  }
  const together = seen.tool === "ball" && seen.all === "yes";
  const frame = framed(size, together ? `/brightest?${new URLSearchParams({ folder: state.folder, of: photographs.length, from: onBall ? photographs[0] : "" })}` : `/photograph?${new URLSearchParams({ name, size: "large" })}`);
  if (seen.tool !== "ball" && (state.mask_found || state.painted)) frame.append(h("img", { src: `/overlay?${version}-${state.painted}`, alt: "", id: "overlay" }));
  frame.append(drawing(size, frame, onBall));
  stage.replaceChildren(frame);
}
function framed([width, height], src) {
  const frame = h("div", { class: "frame" }, h("img", { src, alt: "", draggable: "false", id: "picture" }));
  frame.fit = () => {
    const stage = $("stage"), scale = Math.min((stage.clientWidth - 8) / width, (stage.clientHeight - 8) / height);
    frame.style.width = `${Math.max(scale * width, 1)}px`;
    frame.style.height = `${Math.max(scale * height, 1)}px`;
  };
  frame.fit();
  return frame;
}
addEventListener("resize", () => { for (const frame of document.querySelectorAll(".frame")) frame.fit(); });
new ResizeObserver(() => { for (const frame of document.querySelectorAll(".frame")) frame.fit(); }).observe($("stage"));

function drawing(size, frame, onBall) {
  const tool = view().tool, svg = h("svg", { viewBox: `0 0 ${size[0]} ${size[1]}`, class: tool === "ball" ? "" : "idle", id: "drawing" });
  const place = placeIn(svg, size);
  if (!state.ball_size || onBall) {
    const circles = state.circles.map(one => [...one]);
    circles.forEach((one, k) => svg.append(...ballOf(one, k, circles, place, svg, size)));
    if (tool === "ball" && !running()) svg.addEventListener("pointerdown", event => {
      if (event.target !== svg || event.button) return;
      const start = place(event), fresh = [...start, 1], [ball] = ballOf(fresh, circles.length, circles, place, svg, size);
      svg.append(ball);
      drag(event, svg, now => { fresh[2] = Math.max(Math.hypot(now[0] - start[0], now[1] - start[1]), 1); shape(ball, fresh); }, place,
        () => fresh[2] > 0.01 * size[0] ? send({ do: "circles", circles: [...(state.by_hand ? circles : []), fresh] }) : ball.remove());
    });
  }
  if (tool === "scale") {
    const line = h("line", { class: "rule", id: "rule" });
    const show = ([x1, y1, x2, y2]) => { for (const [key, value] of Object.entries({ x1, y1, x2, y2 })) line.setAttribute(key, value); };
    if (known) show(known);
    svg.append(line);
    if (!running()) svg.addEventListener("pointerdown", event => {
      if (event.button) return;
      const start = place(event);
      let end = start;
      drag(event, svg, now => { end = now; show([...start, ...end]); }, place,
        () => { known = Math.hypot(end[0] - start[0], end[1] - start[1]) > 2 ? [...start, ...end] : null; draw(); const field = $("length"); if (field) field.focus(); });
    });
    return svg;
  }
  if (COLOURS[tool] && !running()) {
    frame.classList.add("paint");
    const circle = h("circle", { class: "brush", r: 0 });
    svg.append(circle);
    const radius = () => brush * Math.max(...size);
    svg.addEventListener("pointermove", event => { const [x, y] = place(event); circle.setAttribute("cx", x); circle.setAttribute("cy", y); circle.setAttribute("r", radius()); });
    svg.addEventListener("pointerdown", event => {
      if (event.button) return;
      const points = [place(event)], line = h("polyline", { class: "drawn", stroke: COLOURS[tool], "stroke-width": 2 * radius(), points: `${points[0]} ${points[0]}` });
      svg.append(line);
      drag(event, svg, now => { if (points.length < 5000) points.push(now); line.setAttribute("points", points.map(String).join(" ")); }, place,
        () => send({ do: "stroke", paints: tool, radius: radius(), points: points.map(([x, y]) => [Math.round(10 * x) / 10, Math.round(10 * y) / 10]) }));
    });
  }
  return svg;
}
function ballOf(one, number, circles, place, svg, size) {
  const ball = h("circle", { class: `ball ${state.by_hand ? "hand" : ""}`, id: `ball-${number}` });
  const grip = h("circle", { class: "grip", id: `grip-${number}`, r: 0.006 * Math.max(...size) });
  const both = () => { shape(ball, one); grip.setAttribute("cx", one[0] + one[2]); grip.setAttribute("cy", one[1]); };
  both();
  if (view().tool !== "ball") return [ball];
  const moved = change => event => {
    if (running() || event.button) return;
    event.stopPropagation();
    const from = place(event), before = [...one];
    drag(event, svg, now => { change(now, from, before); both(); }, place, () => send({ do: "circles", circles }));
  };
  ball.addEventListener("pointerdown", moved((now, from, before) => { one[0] = before[0] + now[0] - from[0]; one[1] = before[1] + now[1] - from[1]; }));
  grip.addEventListener("pointerdown", moved(now => { one[2] = Math.max(Math.hypot(now[0] - one[0], now[1] - one[1]), 1); }));
  return [ball, grip];
}
function cornersOf(size) {
  const svg = h("svg", { viewBox: `0 0 ${size[0]} ${size[1]}`, id: "drawing" }), corners = state.corners.map(one => [...one]);
  const line = h("polyline", { class: "chart" }), place = placeIn(svg, size);
  svg.append(line);
  const redraw = () => line.setAttribute("points", [...corners, ...(corners.length === 4 ? [corners[0]] : [])].map(String).join(" "));
  const keep = () => corners.length === 4 && send({ do: "corners", corners });
  const grip = one => {
    const circle = h("circle", { class: "grip", r: 0.008 * Math.max(...size), cx: one[0], cy: one[1] });
    circle.addEventListener("pointerdown", event => {
      event.stopPropagation();
      drag(event, svg, now => { [one[0], one[1]] = now; circle.setAttribute("cx", now[0]); circle.setAttribute("cy", now[1]); redraw(); }, place, keep);
    });
    svg.append(circle);
  };
  corners.forEach(grip);
  redraw();
  if (!running()) svg.addEventListener("pointerdown", event => {
    if (event.button || corners.length === 4) return;
    corners.push(place(event));
    grip(corners[corners.length - 1]);
    redraw();
    keep();
  });
  return svg;
}
function placeIn(svg, size) {
  return event => {
    const box = svg.getBoundingClientRect();
    return [(event.clientX - box.left) / box.width * size[0], (event.clientY - box.top) / box.height * size[1]];
  };
}
function shape(ball, [x, y, r]) { ball.setAttribute("cx", x); ball.setAttribute("cy", y); ball.setAttribute("r", r); }
function drag(event, svg, moves, place, ends) {
  event.preventDefault();
  svg.setPointerCapture(event.pointerId);
  dragging = true;
  const move = one => moves(place(one));
  const end = () => { svg.removeEventListener("pointermove", move); dragging = false; ends(); };
  svg.addEventListener("pointermove", move);
  svg.addEventListener("pointerup", end, { once: true });
  svg.addEventListener("pointercancel", end, { once: true });
}

// --- the strip of photographs ---
function drawStrip() {
  const names = state.order || state.photographs, strip = $("strip"), kept = strip.scrollLeft;
  strip.replaceChildren(...names.map((name, k) => {
    const lamp = state.lamps && state.lamps[k], glyph = h("svg", { viewBox: "-12 -12 24 24" });
    if (lamp) { const [x, y] = onDome(lamp); glyph.append(h("circle", { r: 11, fill: "#ffffffd0", stroke: "#1f5f8b" }), h("circle", { cx: 9 * x, cy: -9 * y, r: 3, fill: "#e08a00" })); }
    const button = h("button", {
      "aria-current": String(name === current()), class: chosen === name ? "chosen" : "", title: name, draggable: state.lamps_in_file && !running() ? "true" : "false", "data-name": name,
      onclick: () => pick(name),
      ondragstart: event => event.dataTransfer.setData("text/plain", name),
      ondragover: event => { event.preventDefault(); button.classList.add("over"); },
      ondragleave: () => button.classList.remove("over"),
      ondrop: event => { event.preventDefault(); const other = event.dataTransfer.getData("text/plain"); if (other !== name && names.includes(other)) send({ do: "swap", names: [other, name] }); },
    }, h("span", { class: "thumb" }, h("img", { src: `/photograph?${new URLSearchParams({ name, size: "small" })}`, alt: "", loading: "lazy", draggable: "false" }), lamp ? glyph : null), h("span", { class: "tag" }, `${k + 1} · ${name}`));
    return h("li", {}, button);
  }));
  strip.scrollLeft = kept;
}
function pick(name) {
  if (view().tool !== "swap" || running()) return look({ photograph: name, shows: "photograph" });
  if (chosen === null || chosen === name) { chosen = chosen === name ? null : name; return draw(); }
  const names = [chosen, name];
  chosen = null;
  return send({ do: "swap", names });
}
addEventListener("keydown", event => {
  if (!state || !state.order || ["INPUT", "SELECT"].includes(document.activeElement.tagName) || $("ask").open) return;
  const by = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
  if (by) { const k = state.order.indexOf(current()) + by; if (state.order[k]) look({ photograph: state.order[k] }); }
});

// --- the command and how far it is ---
function drawCommand() {
  const job = state.job, busy = running();
  $("running").hidden = !busy;
  const shown = [];
  for (const name of SECTIONS.find(one => one.name === view().section).steps) {
    const step = stepOf(name);
    if (step && step.command) shown.push(step.command);
  }
  if (busy) {
    $("share").value = job.share;
    const step = stepOf(job.step);
    $("said").textContent = `${step ? step.title : job.step} (${job.number} of ${job.steps}) ${Math.round(100 * job.share)} % ${job.said}`;
    $("cancel").disabled = job.cancelled;
  }
  const next = busy ? [job.shown] : shown;
  if (copied() !== next.join("\n")) $("shown").replaceChildren(...next.map(one => h("div", {}, one)));
  $("line").hidden = !next.length;
  $("take").hidden = true;
  $("log").hidden = !job || !job.lines.length;
  if (!job) return;
  const last = $("last"), lines = job.lines, end = lines.length ? lines[lines.length - 1] : "";
  last.className = busy ? "" : job.cancelled ? "" : job.status === 0 ? "good" : "wrong";
  const refused = !busy && !job.cancelled && job.status !== 0;
  last.textContent = busy ? end : job.cancelled ? "Cancelled. What was finished before is kept." : refused ? job.refused.replace(/^hagoromo: /, "") : `Done: ${end}`;
  $("take").hidden = !(refused && job.circle && !state.by_hand);
  $("lines").textContent = lines.join("\n");
}
const copied = () => [...$("shown").children].map(one => one.textContent).join("\n");
$("take").addEventListener("click", async () => {
  if (await send({ do: "circles", circles: [state.job.circle] })) look({ section: "photographs", tool: "ball", shows: "photograph", all: "yes" });
});
$("cancel").addEventListener("click", () => send({ do: "cancel" }));
$("copy").addEventListener("click", async () => {
  await navigator.clipboard.writeText(copied());
  $("copy").textContent = "Copied";
  setTimeout(() => { $("copy").textContent = "Copy"; }, 1200);
});

poll();
