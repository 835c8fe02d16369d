// ---------------------------------------------------------------- scale bar, and notes on places of the picture
// A file of notes is W3C's Web Annotation, in pixels of the photographs, as hagoromo_page/publication/notes.py reads it.

const NEAR_NOTE = 14, MARK = 9, LIMITS = data.noteLimits;  // px of the screen: of a click that means a note, radius of its mark
const corner = data.corner || [0, 0];
let notes = (data.notes || []).map(([x, y, text]) => ({ x, y, text })), unsaved = false, meanDepth = 0;

const onPage = (note) => [(note.x - corner[0]) / data.pixel, (note.y - corner[1]) / data.pixel];

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
    const [cx, cy] = at(onPage(note));
    overlay.append(element("circle", { class: "hv-note", cx, cy, r: MARK }), element("text", { class: "hv-note", x: cx, y: cy + 4 }, String(k + 1)));
  });
}

function listNotes() {
  byId("hv-notes-list").replaceChildren(...notes.map((note, k) => {
    const item = document.createElement("li"), text = document.createElement("textarea");
    Object.assign(text, { value: note.text, rows: 2, maxLength: LIMITS.letters });
    text.setAttribute("aria-label", `Note ${k + 1}`);
    text.addEventListener("input", () => { note.text = text.value; unsaved = true; });
    text.addEventListener("focus", () => { const [x, y] = onPage(note); if (!seen(x, y)) { [state.x, state.y] = [x, y]; ask(); } });
    item.append(text, button("Remove", null, () => { notes.splice(k, 1); unsaved = true; listNotes(); ask(); }));
    return item;
  }));
  byId("hv-save-notes").disabled = !notes.length;
  if (notes.length) byId("hv-notes").open = true;
}

function seen(x, y) {
  const pane = panes()[panes().length - 1];
  return Math.abs(x - state.x) * state.scale < pane.width / 2 && Math.abs(y - state.y) * state.scale < pane.height / 2;
}

function noteAt(x, y) {  // page [px]: the note there, or a new one
  const near = (NEAR_NOTE * (window.devicePixelRatio || 1)) / state.scale;
  let k = notes.findIndex((one) => Math.hypot(...onPage(one).map((v, i) => v - [x, y][i])) < near);
  if (k < 0) {
    if (x < 0 || y < 0 || x > data.width || y > data.height || notes.length >= LIMITS.notes) return;
    const place = [x, y].map((v, i) => Number((corner[i] + v * data.pixel).toFixed(2)));
    k = notes.push({ x: place[0], y: place[1], text: "" }) - 1;
    unsaved = true;
    listNotes();
  }
  ask();
  byId("hv-notes-list").children[k].firstChild.focus();
}

function notesFile() {
  const items = notes.map(({ x, y, text }, k) => ({
    id: `urn:hagoromo:note:${k + 1}`, type: "Annotation", motivation: "commenting", body: { type: "TextualBody", value: text, format: "text/plain" },
    target: { source: data.title, selector: { type: "FragmentSelector", conformsTo: "http://www.w3.org/TR/media-frags/", value: `xywh=pixel:${x},${y},0,0` } },
  }));
  return JSON.stringify({ "@context": "http://www.w3.org/ns/anno.jsonld", id: "urn:hagoromo:notes", type: "AnnotationPage", items }, null, 1);
}

function takeNotes(text) {
  const items = JSON.parse(text).items, place = /xywh=(?:pixel:)?([0-9.]+),([0-9.]+),([0-9.]+),([0-9.]+)$/;
  const made = items.map(({ body, target }) => {
    const [x, y, w, h] = place.exec(typeof target === "string" ? target : target.selector.value).slice(1).map(Number);
    if (body.value.length > LIMITS.letters) throw new Error(`a note has more than ${LIMITS.letters} letters`);
    return { x: x + w / 2, y: y + h / 2, text: String(body.value) };
  });
  if (made.length > LIMITS.notes) throw new Error(`it has more than ${LIMITS.notes} notes`);
  const inside = (one) => onPage(one).every((v, i) => v >= 0 && v <= [data.width, data.height][i]);
  if (!made.every(inside)) throw new Error("a note lies beside this picture");
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
