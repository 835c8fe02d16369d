// ---------------------------------------------------------------- scale bar, and notes on places, lines and areas of the picture
// A file of notes is W3C's Web Annotation, in pixels of the photographs, as hagoromo_page/publication/notes.py reads it.

// px of the screen: of a click that means a note, radius of its mark, least length of a stroke, how near its end closes it, how exactly it is kept
const NEAR_NOTE = 14, MARK = 9, LEAST_STROKE = 8, CLOSING = 16, EXACT = 1, LIMITS = data.noteLimits;
const corner = data.corner || [0, 0];
let notes = (data.notes || []).map(([corners, text, closed]) => ({ corners, text, closed })), unsaved = false, meanDepth = 0, stroke = null;

const onPage = (place) => place.map((v, i) => (v - corner[i]) / data.pixel);
const inPhotograph = (p) => p.map((v, i) => Number((corner[i] + v * data.pixel).toFixed(2)));
const outline = (note) => note.corners.map(onPage);

function markOf(note) {  // page [px]: the middle of an area's corners, or the middle corner of a line
  const places = outline(note);
  return note.closed ? [0, 1].map((i) => places.reduce((sum, p) => sum + p[i], 0) / places.length) : places[(places.length - 1) >> 1];
}

function drawBar(pane, ratio) {  // at the mean distance of the object
  if (!data.hasScale || !relief) return;
  if (!meanDepth) { const known = relief.depths.filter((v) => v > 0); meanDepth = known.reduce((sum, v) => sum + v, 0) / known.length; }
  const each = (1000 * meanDepth * 2 * ratio) / ((data.focal[0] + data.focal[1]) * state.scale);  // mm a px of the screen
  const most = (0.22 * pane.width / ratio) * each, power = 10 ** Math.floor(Math.log10(most));
  const length = [5, 2, 1].map((v) => v * power).find((v) => v <= most * (1 + 1e-9)), [value, unit] = length >= 1000 ? [length / 1000, "m"] : length < 0.1 ? [1000 * length, "µm"] : [length, "mm"];
  const x = pane.x / ratio + 14, y = (pane.y + pane.height) / ratio - (state.photograph < 0 ? 14 : 42), end = x + length / each;
  for (const [x1, y1, x2, y2] of [[x, y, end, y], [x, y - 4, x, y + 4], [end, y - 4, end, y + 4]]) overlay.append(element("line", { class: "hv-bar", x1, y1, x2, y2 }));
  overlay.append(element("text", { class: "hv-bar", x: (x + end) / 2, y: y - 7 }, `${Number(value.toPrecision(2))} ${unit}`));
}

function drawNotes(at) {
  notes.forEach((note, k) => {
    const [cx, cy] = at(markOf(note));
    if (note.corners.length > 1) overlay.append(drawnShape(note.closed, outline(note).map(at)));
    overlay.append(element("circle", { class: "hv-note", cx, cy, r: MARK }), element("text", { class: "hv-note", x: cx, y: cy + 4 }, String(k + 1)));
    const said = byId("hv-notes-list").children[k].querySelector("output");
    if (!said.textContent) said.textContent = sizeText(note);  // the depth of the object comes with its tiles
  });
  if (stroke && stroke.length > 1) overlay.append(drawnShape(closes(stroke), stroke.map(at)));
}

function drawnShape(closed, places) {
  return element(closed ? "polygon" : "polyline", { class: "hv-note-line", points: places.map((p) => p.map((v) => v.toFixed(1)).join(",")).join(" ") });
}

function sizeText(note) {  // length of a line over the surface, or the area of a flat outline; "" before it is known
  const places = outline(note), solid = data.hasScale ? relief && places.map((p) => point(...p)) : places.map((p) => [...p.map((v) => v * data.pixel), 0]);
  if (places.length < 2 || !solid || solid.includes(null)) return "";
  const unit = data.hasScale ? "mm" : "px", size = data.hasScale ? 1000 : 1, from = (p, q) => p.map((v, i) => size * (q[i] - v));
  if (!note.closed) return `${solid.slice(1).reduce((sum, p, i) => sum + Math.hypot(...from(solid[i], p)), 0).toPrecision(3)} ${unit} long`;
  const cross = (p, q) => [p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]];
  const fans = solid.slice(2).map((p, i) => cross(from(solid[0], solid[i + 1]), from(solid[0], p)));
  return `${(0.5 * Math.hypot(...[0, 1, 2].map((i) => fans.reduce((sum, one) => sum + one[i], 0)))).toPrecision(3)} ${unit}²`;
}

function listNotes() {
  byId("hv-notes-list").replaceChildren(...notes.map((note, k) => {
    const item = document.createElement("li"), text = document.createElement("textarea");
    Object.assign(text, { value: note.text, rows: 2, maxLength: LIMITS.letters });
    text.setAttribute("aria-label", `Note ${k + 1}`);
    text.addEventListener("input", () => { note.text = text.value; unsaved = true; });
    text.addEventListener("focus", () => { const [x, y] = markOf(note); if (!seen(x, y)) { [state.x, state.y] = [x, y]; ask(); } });
    item.append(text, document.createElement("output"), button("Remove", null, () => { notes.splice(k, 1); unsaved = true; listNotes(); ask(); }));
    return item;
  }));
  byId("hv-save-notes").disabled = !notes.length;
  if (notes.length) byId("hv-notes").open = true;
}

function seen(x, y) {
  const pane = panes()[panes().length - 1];
  return Math.abs(x - state.x) * state.scale < pane.width / 2 && Math.abs(y - state.y) * state.scale < pane.height / 2;
}

const onScreen = (length) => (length * (window.devicePixelRatio || 1)) / state.scale;  // px of the screen → of the page
const distance = (p, q) => Math.hypot(p[0] - q[0], p[1] - q[1]);
const within = (p) => p.every((v, i) => v >= 0 && v <= [data.width, data.height][i]);

function closes(places) {  // whether the end of a stroke is back at its start
  const far = Math.max(...places.map((p) => distance(p, places[0])));
  return far > 3 * onScreen(CLOSING) && distance(places[0], places[places.length - 1]) < onScreen(CLOSING);
}

function fromSegment(p, a, b) {
  const along = [b[0] - a[0], b[1] - a[1]], square = along[0] ** 2 + along[1] ** 2;
  const t = square ? Math.min(Math.max(((p[0] - a[0]) * along[0] + (p[1] - a[1]) * along[1]) / square, 0), 1) : 0;
  return distance(p, [a[0] + t * along[0], a[1] + t * along[1]]);
}

function fewer(places, off) {  // corners of a line that is nowhere further than `off` from all of them (Douglas and Peucker)
  const ends = [places[0], places[places.length - 1]], away = places.map((p) => fromSegment(p, ...ends)), k = away.indexOf(Math.max(...away));
  return away[k] > off ? [...fewer(places.slice(0, k + 1), off).slice(0, -1), ...fewer(places.slice(k), off)] : ends;
}

function addStroke(p) {  // page [px]
  const bounded = p.map((v, i) => Math.min(Math.max(v, 0), [data.width, data.height][i]));
  if (distance(bounded, stroke[stroke.length - 1]) >= onScreen(2)) stroke.push(bounded);
  ask();
}

function endStroke() {  // a click is a place, a stroke a line, or an area where it ends at its start
  const drawn = stroke;
  stroke = null;
  if (!drawn) return;
  if (Math.max(...drawn.map((p) => distance(p, drawn[0]))) < onScreen(LEAST_STROKE)) { noteAt(drawn[0]); return; }
  if (notes.length >= LIMITS.notes || !within(drawn[0])) { ask(); return; }
  const closed = closes(drawn);
  let corners = drawn;
  for (let off = onScreen(EXACT); corners.length > LIMITS.corners || corners === drawn; off *= 2) corners = fewer(drawn, off).slice(0, closed ? -1 : undefined);
  addNote({ corners: corners.map(inPhotograph), text: "", closed: closed && corners.length > 2 });
}

function addNote(note) {
  notes.push(note);
  unsaved = true;
  listNotes();
  write(notes.length - 1);
}

function write(k) {
  ask();
  byId("hv-notes-list").children[k].firstChild.focus();
}

function noteAt(p) {  // page [px]: the note there, or a new one
  const k = notes.findIndex((one) => distance(markOf(one), p) < onScreen(NEAR_NOTE));
  if (k >= 0) write(k);
  else if (within(p) && notes.length < LIMITS.notes) addNote({ corners: [inPhotograph(p)], text: "", closed: false });
}

function selectorOf({ corners, closed }) {
  if (corners.length === 1) return { type: "FragmentSelector", conformsTo: "http://www.w3.org/TR/media-frags/", value: `xywh=pixel:${corners[0]},0,0` };
  return { type: "SvgSelector", value: `<svg xmlns="${SVG}"><${closed ? "polygon" : "polyline"} points="${corners.join(" ")}"/></svg>` };
}

function notesFile() {
  const items = notes.map((note, k) => ({
    id: `urn:hagoromo:note:${k + 1}`, type: "Annotation", motivation: "commenting", body: { type: "TextualBody", value: note.text, format: "text/plain" },
    target: { source: data.title, selector: selectorOf(note) },
  }));
  return JSON.stringify({ "@context": "http://www.w3.org/ns/anno.jsonld", id: "urn:hagoromo:notes", type: "AnnotationPage", items }, null, 1);
}

const NUMBER = /^[0-9]{1,7}([.][0-9]{1,20})?$/;

function numbersOf(tokens) {
  if (!tokens.length || !tokens.every((one) => NUMBER.test(one))) throw new Error("a note has no place in pixels");
  return tokens.map(Number);
}

function whereIs(target) {  // corners [px of the photographs] of a target, as read_notes of notes.py finds them
  const given = typeof target === "string" ? [target] : [].concat(target.selector).map((one) => one.value);
  const drawn = given.find((one) => one.includes("<"));
  if (drawn === undefined) {
    const found = /xywh=(?:pixel:)?([^#]+)$/.exec(given[0]), rectangle = numbersOf(found ? found[1].split(",") : []);
    const [x, y, w, h] = rectangle;
    if (rectangle.length !== 4) throw new Error("a note has no place in pixels");
    return w || h ? { corners: [[x, y], [x + w, y], [x + w, y + h], [x, y + h]], closed: true } : { corners: [[x, y]], closed: false };
  }
  const [, name, attributes] = /<(?:svg:)?(polygon|polyline|path|rect|circle|ellipse|line|text|image|use)\b([^<>]*)>/.exec(drawn) || [];
  const value = new RegExp(`\\b${name === "path" ? "d" : "points"}\\s*=\\s*["']([^"']*)["']`).exec(attributes || ""), tokens = (value ? value[1] : "").match(/[A-Za-z]|[^A-Za-z\s,]+/g) || [];
  const ends = name === "path" && /^z$/i.test(tokens[tokens.length - 1]);
  if (!["polygon", "polyline", "path"].includes(name) || drawn.includes("transform") || (name === "path" && (tokens[0] !== "M" || tokens.slice(1, ends ? -1 : undefined).some((one) => /^[mz]$/i.test(one))))) throw new Error("a note is no polygon, polyline or path of straight lines");
  const numbers = numbersOf(name === "path" ? tokens.filter((one) => !/^[MLZz]$/.test(one)) : tokens);
  if (numbers.length % 2 || numbers.length > 2 * LIMITS.corners) throw new Error(`a note has more than ${LIMITS.corners} corners, or half a one`);
  const corners = numbers.filter((_, i) => i % 2 === 0).map((x, i) => [x, numbers[2 * i + 1]]);
  return { corners, closed: corners.length > 2 && (name === "polygon" || ends) };
}

function takeNotes(text) {
  const read = JSON.parse(text), made = (Array.isArray(read) ? read : read.items).map(({ body, target }) => {
    const note = { ...whereIs(target), text: [].concat(body).map((one) => String(one.value)).join("\n") };
    if (note.text.length > LIMITS.letters) throw new Error(`a note has more than ${LIMITS.letters} letters`);
    return note;
  });
  if (made.length > LIMITS.notes) throw new Error(`it has more than ${LIMITS.notes} notes`);
  if (!made.every((one) => outline(one).some(within))) throw new Error("a note lies beside this picture");
  notes = made;
  unsaved = false;
  listNotes();
  ask();
}

function connectNotes() {
  byId("hv-save-notes").addEventListener("click", () => {
    const link = document.createElement("a"), address = URL.createObjectURL(new Blob([notesFile()], { type: "application/ld+json" }));
    Object.assign(link, { href: address, download: "notes.json" });
    link.click();
    setTimeout(() => URL.revokeObjectURL(address), 10000);
    unsaved = false;
  });
  byId("hv-open-notes").addEventListener("change", async (happened) => {
    const file = happened.target.files[0];
    happened.target.value = "";
    if (!file || (unsaved && !window.confirm("Replace the notes that are not saved?"))) return;
    try {
      if (file.size > LIMITS.bytes) throw new Error(`it is larger than ${LIMITS.bytes >> 20} MiB`);
      takeNotes(await file.text());
      status.textContent = `${file.name}: ${notes.length} notes`;
    } catch (error) { status.textContent = `${file.name} holds no notes of this picture: ${error.message}`; }
  });
  window.addEventListener("beforeunload", (happened) => { if (unsaved) happened.preventDefault(); });
  listNotes();
}
