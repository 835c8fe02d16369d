// The viewer of a published object: unpacks its maps, lights them in WebGL2, and answers mouse, touch and keys.
const byId = (id) => document.getElementById(id);
const data = JSON.parse(byId("hv-data").textContent);
const LAMPS = 4, COARSE = 512, MOST_TILES = 64, STEP = Math.PI / 90, VIEWS = data.views;
const CASTS = !!data.scales.depth && !data.stack;  // shadows by the depth of the object; weights have theirs
const canvas = byId("hv-canvas"), frame = byId("hv-frame"), overlay = byId("hv-overlay");
const message = byId("hv-message"), status = byId("hv-status");
const gl = canvas.getContext("webgl2", { alpha: false, antialias: false, preserveDrawingBuffer: true });
const SVG = overlay.namespaceURI;

// ---------------------------------------------------------------- unpacking (hagoromo_page/publication/planes.py)

async function inflated(text) {
  const packed = Uint8Array.from(atob(text), (one) => one.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

function unfolded(low, high, width, height, predictor) {
  const values = new Uint16Array(width * height);
  for (let r = 0, i = 0; r < height; r++) {
    for (let c = 0; c < width; c++, i++) {
      const left = c ? values[i - 1] : r ? values[i - width] : 0;
      const above = r ? values[i - width] : left;
      const diagonal = r && c ? values[i - width - 1] : r ? above : left;
      const guess = predictor === "left" ? left : predictor === "mean" ? (left + above) >> 1 : predictor === "middle" ? 32768 : left + above - diagonal;
      const folded = low[i] | (high ? high[i] << 8 : 0);
      values[i] = guess + (folded & 1 ? -((folded + 1) >> 1) : folded >> 1);
    }
  }
  return values;
}

async function unpacked(header, text) {
  const bytes = await inflated(text), size = header.width * header.height, planes = {};
  let at = 0;
  for (const one of header.planes) {
    const low = bytes.subarray(at, (at += size)), high = one.high ? bytes.subarray(at, (at += size)) : null;
    planes[one.name] = unfolded(low, high, header.width, header.height, one.predictor);
  }
  return planes;
}

// ---------------------------------------------------------------- state

const state = {
  lamps: [], lamp: 0, camera: 0, balance: true, stops: 0, view: 0, shadows: CASTS, enhance: 0, width: 10,
  tool: "light", scale: 0, x: data.width / 2, y: data.height / 2, photograph: -1,
};
let stamp = 1, shadowStamp = 0, asked = false, relief = null, ruler = null, heights = null, turn = 0;

const lampAt = (x, y) => ({ x, y, strength: 1, spectrum: 0, capture: -1 });
state.lamps.push(lampAt(-0.33, 0.36));

function direction(lamp) {  // pad → unit direction; the radius is the angle from the camera over 90°
  const radius = Math.hypot(lamp.x, lamp.y), angle = (radius * Math.PI) / 2;
  const s = radius > 0 ? Math.sin(angle) / radius : 0;
  return [lamp.x * s, lamp.y * s, Math.cos(angle)];
}

function toPad(d) {
  const across = Math.hypot(d[0], d[1]), radius = Math.atan2(across, d[2]) / (Math.PI / 2);
  return across > 0 ? [(d[0] / across) * radius, (d[1] / across) * radius] : [0, 0];
}

function place(lamp, x, y) {
  const radius = Math.hypot(x, y), most = 0.985;
  lamp.x = radius > most ? (x / radius) * most : x;
  lamp.y = radius > most ? (y / radius) * most : y;
  lamp.capture = -1;
  changed();
}

function light(lamp) {  // place [x y z w], axis, irradiance at the middle of the object is π · strength
  const own = lamp.capture >= 0 ? data.lamps[lamp.capture] : null;
  if (!own) return { at: [...direction(lamp), 0], axis: [0, 0, 0, 0], scale: Math.PI * lamp.strength, colour: null };
  if (own.far) return { at: [...own.at, 0], axis: own.axis, scale: Math.PI * lamp.strength, colour: own.colour };
  const offset = own.at.map((v, i) => v - data.middle[i]), distance = Math.hypot(...offset);
  const facing = own.axis[3] > 0 ? offset.reduce((sum, v, i) => sum - (v / distance) * own.axis[i], 0) ** own.axis[3] : 1;
  return { at: [...own.at, 1], axis: own.axis, scale: (Math.PI * lamp.strength * distance ** 2) / facing, colour: own.colour };
}

// ---------------------------------------------------------------- colours (MODEL §5)

function product(a, b) {
  return a.map((row) => b[0].map((_, j) => row.reduce((sum, v, i) => sum + v * b[i][j], 0)));
}

function toDisplay() {
  const colours = data.colours;
  return state.balance ? colours.balanced[state.camera][state.lamps[0].spectrum] : colours.daylight[state.camera];
}

function lampColours(lamp) {  // display colours of a unit of each body channel, and of each material's interface
  const colours = data.colours, own = light(lamp).colour;
  let body = product(toDisplay(), colours.body[state.camera][lamp.spectrum]);
  let interfaces = colours.interface.length ? colours.interface[state.camera][lamp.spectrum] : null;
  if (own && !colours.exact) {
    body = body.map((row) => row.map((v, c) => v * own[c]));
    interfaces = interfaces.map((row, c) => row.map((v) => v * own[c]));
  }
  return { body, interface: interfaces && product(toDisplay(), interfaces) };
}

// ---------------------------------------------------------------- WebGL

const QUAD = `#version 300 es
uniform vec4 box; out vec2 uv;
void main() { vec2 q = vec2(gl_VertexID & 1, gl_VertexID >> 1); uv = q; gl_Position = vec4(mix(box.xy, box.zw, q), 0.0, 1.0); }`;
const PICTURE = `#version 300 es
precision highp float; uniform sampler2D picture; uniform float gain; in vec2 uv; out vec4 shown;
void main() {
  vec4 c = texture(picture, uv);
  if (gain > 0.0) {
    vec3 l = gain * mix(pow((c.rgb + 0.055) / 1.055, vec3(2.4)), c.rgb / 12.92, vec3(lessThanEqual(c.rgb, vec3(0.04045))));
    l = clamp(l, 0.0, 1.0);
    c.rgb = mix(1.055 * pow(max(l, vec3(0.0031308)), vec3(1.0 / 2.4)) - 0.055, 12.92 * l, vec3(lessThanEqual(l, vec3(0.0031308))));
  }
  shown = c;
}`;

function program(fragment) {
  const made = gl.createProgram();
  for (const [kind, source] of [[gl.VERTEX_SHADER, QUAD], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
    gl.attachShader(made, shader);
  }
  gl.linkProgram(made);
  if (!gl.getProgramParameter(made, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(made));
  const places = {};
  return { made, at: (name) => (name in places ? places[name] : (places[name] = gl.getUniformLocation(made, name))) };
}

function texture(target, format, width, height, layers, values, kind, part) {
  const made = gl.createTexture();
  gl.bindTexture(target, made);
  gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
  for (const key of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(target, key, gl.NEAREST);
  for (const key of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(target, key, gl.CLAMP_TO_EDGE);
  if (layers) gl.texImage3D(target, 0, format, width, height, layers, 0, part, kind, values);
  else gl.texImage2D(target, 0, format, width, height, 0, part, kind, values);
  return made;
}

function interleaved(planes, names, size) {
  const values = new Uint16Array(4 * size);
  names.forEach((name, k) => { const one = planes[name]; if (one) for (let i = 0; i < size; i++) values[4 * i + k] = one[i]; });
  return values;
}

const float = (v) => (Number.isInteger(v) ? `${v}.0` : `${v}`);
const pair = (v) => `vec2(${v.map(float).join(", ")})`;
let shade, shadow, show, raysTexture, materialsTexture, shadowTarget = null, buffer, photographTextures = {};

function prepare() {
  const head = `#version 300 es\nprecision highp float;\nprecision highp int;\nprecision highp usampler2D;\nprecision highp usampler2DArray;\nprecision highp sampler2D;\n`;
  show = program(PICTURE);
  buffer = gl.createFramebuffer();
  gl.bindVertexArray(gl.createVertexArray());
  gl.disable(gl.DITHER);
  if (data.stack) { shade = program(`${head}#define LAYERS ${stackLayers()}\n${data.shaders.stack}`); return; }
  const sizes = `#define LAMPS ${LAMPS}\n#define LOBES ${data.lobes}\n#define CHANNELS ${data.scales.channels}\n#define SCALE_GAMMA ${pair(data.legend.gamma)}\n#define SCALE_PEAK ${pair(data.legend.peak)}\n`;
  shade = program(head + sizes + data.shaders.shade);
  shadow = program(head + sizes + data.shaders.shadow);
  const rays = data.rays;
  raysTexture = texture(gl.TEXTURE_2D, gl.RG32F, rays.columns, rays.rows, 0, new Float32Array(rays.values), gl.FLOAT, gl.RG);
}

function target(width, height, mipmaps) {
  const made = gl.createTexture();
  gl.bindTexture(gl.TEXTURE_2D, made);
  gl.texStorage2D(gl.TEXTURE_2D, mipmaps ? Math.floor(Math.log2(Math.max(width, height))) + 1 : 1, gl.RGBA8, width, height);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, mipmaps ? gl.LINEAR_MIPMAP_LINEAR : gl.LINEAR);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.LINEAR);
  for (const key of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, key, gl.CLAMP_TO_EDGE);
  return made;
}

function into(one, width, height) {
  gl.bindFramebuffer(gl.FRAMEBUFFER, buffer);
  gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, one, 0);
  gl.viewport(0, 0, width, height);
  gl.disable(gl.SCISSOR_TEST);
  gl.disable(gl.BLEND);
}

function bound(used, name, unit, kind, one) {
  gl.activeTexture(gl.TEXTURE0 + unit);
  gl.bindTexture(kind, one);
  gl.uniform1i(used.at(name), unit);
}

function updateMaterials() {
  if (data.stack) return;
  const count = data.materials.length, rows = 2 + LAMPS + data.lobes, values = new Float32Array(4 * count * rows);
  data.materials.forEach((one, m) => {
    values.set([one.beta, one.gamma, one.n, one.tail], 4 * m);
    values.set([2 ** one.tail - 1, one.epsilon, one.sigma, one.grey ? 1 : 0], 4 * (count + m));
    for (let l = 0; l < data.lobes; l++) values.set(one.lobes[l] || [0, 1], 4 * ((2 + LAMPS + l) * count + m));
  });
  state.lamps.forEach((lamp, k) => {
    const colours = lampColours(lamp).interface;
    for (let m = 0; m < count; m++) for (let c = 0; c < 3; c++) values[4 * ((2 + k) * count + m) + c] = colours[c][m];
  });
  if (materialsTexture) gl.deleteTexture(materialsTexture);
  materialsTexture = texture(gl.TEXTURE_2D, gl.RGBA32F, count, rows, 0, values, gl.FLOAT, gl.RGBA);
}

// ---------------------------------------------------------------- tiles

// <stack.js>

const tiles = new Map();

class Tile {
  constructor(level, x, y, header, planes) {
    const size = header.width * header.height, layers = Math.ceil(data.scales.channels / 4);
    Object.assign(this, { level, x, y, width: header.width, height: header.height, stamp: 0, shownAt: turn });
    const upload = (names) => texture(gl.TEXTURE_2D, gl.RGBA16UI, this.width, this.height, 0, interleaved(planes, names, size), gl.UNSIGNED_SHORT, gl.RGBA_INTEGER);
    this.geometry = upload(["u", "v", "depth", "label"]);
    if (planes.tail) {
      const errors = planes.normal_error;
      planes.with_tail = planes.tail.map((tail, i) => 256 * tail + (errors ? errors[i] : 0));
    }
    this.extra = upload(["beta", "gamma", planes.tail ? "with_tail" : "normal_error", (VIEWS.find((one) => one.number === 6) || {}).error]);
    const bodies = new Uint16Array(4 * size * layers);
    for (let k = 0; k < layers; k++) bodies.set(interleaved(planes, [0, 1, 2, 3].map((c) => `body${4 * k + c}`), size), 4 * size * k);
    this.bodies = texture(gl.TEXTURE_2D_ARRAY, gl.RGBA16UI, this.width, this.height, layers, bodies, gl.UNSIGNED_SHORT, gl.RGBA_INTEGER);
    this.closely = planes.curvature ? upload(["curvature", "occlusion"]) : this.extra;
    this.heights = planes.depth ? { label: planes.label, depth: planes.depth, width: planes.width } : null;
    this.target = target(this.width, this.height, true);
  }

  shade() {
    if (this.stamp === stamp) return;
    const scales = data.scales, lights = state.lamps.map(light), used = shade;
    into(this.target, this.width, this.height);
    gl.useProgram(used.made);
    gl.uniform4f(used.at("box"), -1, -1, 1, 1);
    bound(used, "geometry", 0, gl.TEXTURE_2D, this.geometry);
    bound(used, "bodies", 1, gl.TEXTURE_2D_ARRAY, this.bodies);
    bound(used, "extra", 2, gl.TEXTURE_2D, this.extra);
    bound(used, "materials", 3, gl.TEXTURE_2D, materialsTexture);
    bound(used, "rays", 4, gl.TEXTURE_2D, raysTexture);
    bound(used, "shadows", 5, gl.TEXTURE_2D, shadowTarget);
    bound(used, "closely", 6, gl.TEXTURE_2D, this.closely);
    const factor = data.levels[this.level].factor, view = VIEWS[state.view];
    gl.uniform2f(used.at("tileOrigin"), this.x, this.y);
    gl.uniform1f(used.at("levelFactor"), factor);
    gl.uniform2f(used.at("pageSize"), data.width, data.height);
    for (const [name, key] of [["depthRange", "depth"], ["betaRange", "beta"], ["gammaRange", "gamma"], ["tailRange", "tail"]])
      gl.uniform2fv(used.at(name), scales[key] || (key === "depth" ? [1, 1] : [0, 0]));
    gl.uniform2fv(used.at("errorRange"), (view.error && scales[view.error]) || [0, 0]);
    gl.uniform1f(used.at("normalTop"), 2 ** scales.normal_bits - 1);
    gl.uniform1f(used.at("bodyTop"), 2 ** scales.body_bits - 1);
    gl.uniform1f(used.at("bodyScale"), scales.body);
    gl.uniform1f(used.at("glossTop"), 4095);
    gl.uniform1f(used.at("errorTop"), 255);
    gl.uniform1i(used.at("lampCount"), lights.length);
    gl.uniform4fv(used.at("lampAt"), lights.flatMap((one) => one.at));
    gl.uniform4fv(used.at("lampAxis"), lights.flatMap((one) => one.axis));
    gl.uniform1fv(used.at("lampScale"), lights.map((one) => one.scale));
    const columns = [];
    for (const lamp of state.lamps) {
      const body = lampColours(lamp).body;
      for (let c = 0; c < scales.channels; c++) columns.push(body[0][c], body[1][c], body[2][c]);
    }
    gl.uniform3fv(used.at("bodyColumns"), columns);
    const stretch = (data.closely && data.closely.stretch) || { columns: Array(scales.channels).fill([0, 0, 0]), offset: [0, 0, 0] };
    gl.uniform3fv(used.at("stretchColumns"), stretch.columns.flat());
    gl.uniform3fv(used.at("stretchOffset"), stretch.offset);
    gl.uniform3fv(used.at("stops"), (view.stops || [[0, 0, 0], [0, 0, 0], [0, 0, 0]]).flat());
    gl.uniform1i(used.at("view"), view.number);
    gl.uniform1i(used.at("ofGloss"), view.gloss ? 1 : 0);
    gl.uniform1f(used.at("exposure"), data.exposure * 2 ** state.stops);
    gl.uniform1f(used.at("albedoFactor"), data.albedoFactor);
    gl.uniform1i(used.at("withShadows"), state.shadows && relief && view.number === 0 ? 1 : 0);
    gl.uniform1f(used.at("enhancement"), state.enhance);
    gl.uniform1f(used.at("enhancementWidth"), (state.width * Math.PI) / 180);
    gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
    gl.bindTexture(gl.TEXTURE_2D, this.target);
    gl.generateMipmap(gl.TEXTURE_2D);
    this.stamp = stamp;
  }
}

function updateShadows() {
  if (!relief || !state.shadows || shadowStamp === stamp) return;
  into(shadowTarget, relief.width, relief.height);
  gl.useProgram(shadow.made);
  gl.uniform4f(shadow.at("box"), -1, -1, 1, 1);
  bound(shadow, "relief", 0, gl.TEXTURE_2D, relief.texture);
  gl.uniform2f(shadow.at("focal"), relief.focal[0], relief.focal[1]);
  gl.uniform2f(shadow.at("centre"), relief.centre[0], relief.centre[1]);
  gl.uniform1f(shadow.at("nearest"), data.scales.depth[0]);
  gl.uniform1i(shadow.at("lampCount"), state.lamps.length);
  gl.uniform4fv(shadow.at("lampAt"), state.lamps.flatMap((one) => light(one).at));
  gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
  shadowStamp = stamp;
}

function medians(depths, width, height) {  // over 5 × 5 px: spikes of the measured depth would throw shadows
  const made = new Float32Array(depths.length), around = new Float32Array(25);
  for (let r = 0, i = 0; r < height; r++) for (let c = 0; c < width; c++, i++) {
    if (!depths[i]) continue;
    let count = 0;
    for (let y = Math.max(r - 2, 0); y <= Math.min(r + 2, height - 1); y++)
      for (let x = Math.max(c - 2, 0); x <= Math.min(c + 2, width - 1); x++) if (depths[y * width + x]) around[count++] = depths[y * width + x];
    made[i] = around.subarray(0, count).sort()[count >> 1];
  }
  return made;
}

function makeRelief(header, planes, factor) {  // depth of a coarse picture, for shadows and the ruler
  const step = Math.max(1, Math.ceil(Math.max(header.width, header.height) / COARSE));
  const width = Math.ceil(header.width / step), height = Math.ceil(header.height / step), whole = step * factor;
  const depths = new Float32Array(width * height), range = data.scales.depth;
  for (let r = 0; r < height; r++) for (let c = 0; c < width; c++) {
    const y = Math.min(r * step + (step >> 1), header.height - 1), x = Math.min(c * step + (step >> 1), header.width - 1);
    const i = y * header.width + x;
    if (planes.label[i]) depths[r * width + c] = range[0] + ((range[1] - range[0]) * planes.depth[i]) / 65535;
  }
  const smooth = medians(depths, width, height);
  const offset = step > 1 ? (step >> 1) + 0.5 - step / 2 : 0;  // of the sample from the middle of its square
  const one = texture(gl.TEXTURE_2D, gl.R32F, width, height, 0, smooth, gl.FLOAT, gl.RED);
  const across = (width * whole) / data.width, down = (height * whole) / data.height;
  relief = { width, height, whole, depths, texture: one, focal: data.focal.map((v) => v / whole), across, down,
    centre: data.principal.map((v) => (v - offset * factor) / whole) };
  if (shadowTarget) gl.deleteTexture(shadowTarget);
  shadowTarget = target(width, height, false);
}

const wanted = new Set();

async function addTile(key, header, text) {
  const [level, column, row] = key.split("-").map(Number), planes = await unpacked(header, text);
  if (data.scales.depth && !relief && data.levels[level].tiles === 1) makeRelief(header, planes, data.levels[level].factor);
  tiles.set(key, data.stack ? new StackTile(header, planes) : new Tile(level, column * data.side, row * data.side, header, planes));
  ask();
}

function want(key) {  // a tile of a page that is a folder comes as a script, which works without a server
  if (wanted.has(key) || !data.folder) return;
  wanted.add(key);
  const script = document.createElement("script");
  script.src = `tiles/${key}.js`;
  script.onload = () => script.remove();
  document.head.append(script);
}

// ---------------------------------------------------------------- drawing

function panes() {
  const width = canvas.width, height = canvas.height;
  if (state.photograph < 0) return [{ x: 0, y: 0, width, height, photograph: false }];
  if (width >= height * 0.9) {
    const half = width >> 1;
    return [{ x: 0, y: 0, width: half, height, photograph: true }, { x: half, y: 0, width: width - half, height, photograph: false }];
  }
  const half = height >> 1;
  return [{ x: 0, y: 0, width, height: half, photograph: true }, { x: 0, y: half, width, height: height - half, photograph: false }];
}

function levelShown() {
  let best = 0;
  data.levels.forEach((one, k) => { if (one.factor <= 1.001 / state.scale && one.factor > data.levels[best].factor) best = k; });
  return best;
}

function box(pane, x0, y0, x1, y1) {  // rectangle of the page [px] → clip space of its pane
  const snapped = Math.abs(state.scale - Math.round(state.scale)) < 1e-6;
  const left = pane.width / 2 - state.x * state.scale, top = pane.height / 2 - state.y * state.scale;
  const [l, t] = snapped ? [Math.round(left), Math.round(top)] : [left, top];
  const x = (v) => ((l + v * state.scale) / pane.width) * 2 - 1, y = (v) => 1 - ((t + v * state.scale) / pane.height) * 2;
  return [x(x0), y(y0), x(x1), y(y1)];
}

function forget(shown) {  // the tiles that were not seen for longest: memory for MOST_TILES is enough for any screen
  const old = [...tiles].filter(([, one]) => !shown.includes(one) && data.levels[one.level].tiles > 1);
  old.sort((a, b) => a[1].shownAt - b[1].shownAt);
  for (const [key, one] of old.slice(0, Math.max(tiles.size - MOST_TILES, 0))) {
    for (const own of [one.geometry, one.extra, one.bodies, one.target, one.closely]) gl.deleteTexture(own);
    tiles.delete(key);
    wanted.delete(key);
  }
}

function drawPicture(pane, one, corners, gain) {
  gl.useProgram(show.made);
  gl.uniform4fv(show.at("box"), box(pane, ...corners));
  gl.uniform1f(show.at("gain"), gain);
  bound(show, "picture", 0, gl.TEXTURE_2D, one);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, state.scale >= 8 ? gl.NEAREST : gl.LINEAR);
  gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
}

function draw() {
  asked = false;
  if (!fitted()) return;
  updateMaterials();
  updateShadows();
  const level = levelShown(), shown = [];
  for (let k = data.levels.length - 1; k >= level; k--) {
    const columns = Math.ceil(data.levels[k].width / data.side), rows = Math.ceil(data.levels[k].height / data.side);
    for (let row = 0; row < rows; row++) for (let column = 0; column < columns; column++) {
      if (k > level && k < data.levels.length - 1) continue;  // the coarsest level lies below until tiles come
      const key = `${k}-${column}-${row}`, factor = data.levels[k].factor, side = data.side * factor;
      const within = panes().some((pane) => {
        const b = box(pane, column * side, row * side, (column + 1) * side, (row + 1) * side);
        return b[0] < 1 && b[2] > -1 && b[1] > -1 && b[3] < 1;
      });
      if (!within) continue;
      if (tiles.has(key)) shown.push(tiles.get(key)); else want(key);
    }
  }
  for (const one of shown) { one.shade(); one.shownAt = ++turn; }
  forget(shown);
  gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  gl.disable(gl.SCISSOR_TEST);
  gl.clearColor(0.09, 0.094, 0.106, 1);
  gl.clear(gl.COLOR_BUFFER_BIT);
  gl.enable(gl.BLEND);
  gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
  for (const pane of panes()) {
    const bottom = canvas.height - pane.y - pane.height;
    gl.viewport(pane.x, bottom, pane.width, pane.height);
    gl.enable(gl.SCISSOR_TEST);
    gl.scissor(pane.x, bottom, pane.width, pane.height);
    if (pane.photograph) {
      const one = photographTextures[state.photograph], gain = 2 ** state.stops;
      if (one) drawPicture(pane, one, [0, 0, data.width, data.height], gain);
      continue;
    }
    for (const one of shown) {
      const f = data.levels[one.level].factor;
      drawPicture(pane, one.target, [one.x * f, one.y * f, (one.x + one.width) * f, (one.y + one.height) * f], 0);
    }
  }
  drawOverlay();
}

function ask() { if (!asked) { asked = true; requestAnimationFrame(draw); } }
function changed() { stamp++; refresh(); ask(); }

function fitted() {
  const ratio = window.devicePixelRatio || 1, width = Math.round(frame.clientWidth * ratio), height = Math.round(frame.clientHeight * ratio);
  if (!width || !height) return false;
  if (canvas.width !== width || canvas.height !== height) {
    const old = canvas.width;
    canvas.width = width;
    canvas.height = height;
    if (state.scale && old && state.fit) state.scale = 0;
  }
  if (!state.scale) fit();
  return true;
}

function fit() {
  const pane = panes()[0];
  state.scale = Math.min(pane.width / data.width, pane.height / data.height) * 0.96;
  state.x = data.width / 2;
  state.y = data.height / 2;
  state.fit = true;
  refresh();
}

function zoom(factor, px, py) {
  const before = toPage(px, py), scale = Math.min(Math.max(state.scale * factor, 0.02), 32);
  state.scale = scale;
  const after = toPage(px, py);
  state.x += before[0] - after[0];
  state.y += before[1] - after[1];
  state.fit = false;
  refresh();
  ask();
}

function paneAt(px, py) {
  const all = panes();
  return all.find((one) => px >= one.x && px < one.x + one.width && py >= one.y && py < one.y + one.height) || all[all.length - 1];
}

function toPage(px, py, pane = paneAt(px, py)) {  // canvas [device px] → page [px]
  return [state.x + (px - pane.x - pane.width / 2) / state.scale, state.y + (py - pane.y - pane.height / 2) / state.scale];
}

// ---------------------------------------------------------------- ruler and overlay

function element(name, attributes, text) {
  const made = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  if (text) made.textContent = text;
  return made;
}

function point(x, y) {
  const c = Math.floor(x / relief.whole), r = Math.floor(y / relief.whole);
  const depth = c >= 0 && r >= 0 && c < relief.width && r < relief.height ? relief.depths[r * relief.width + c] : 0;
  return depth ? [((x - data.principal[0]) / data.focal[0]) * depth, ((y - data.principal[1]) / data.focal[1]) * depth, depth] : null;
}

function lengthText(a, b) {
  const px = Math.hypot(b[0] - a[0], b[1] - a[1]) * data.pixel;
  if (data.hasScale && relief) {
    const p = point(...a), q = point(...b);
    if (p && q) { const mm = 1000 * Math.hypot(...p.map((v, i) => q[i] - v)); return `${mm.toPrecision(3)} mm`; }
  }
  return `${px.toFixed(1)} px`;
}

function drawOverlay() {
  overlay.replaceChildren();
  const ratio = canvas.width / frame.clientWidth, all = panes();
  if (all.length > 1) {
    const other = all[1];
    overlay.append(element("line", { class: "hv-split", x1: other.x / ratio, y1: other.y / ratio,
      x2: (other.x ? other.x : canvas.width) / ratio, y2: (other.y ? other.y : canvas.height) / ratio }));
  }
  const pane = all[all.length - 1];
  const at = (p) => [(pane.x + pane.width / 2 + (p[0] - state.x) * state.scale) / ratio, (pane.y + pane.height / 2 + (p[1] - state.y) * state.scale) / ratio];
  drawBar(pane, ratio);
  drawNotes(at);
  if (!ruler) return;
  const [a, b] = [at(ruler[0]), at(ruler[1])];
  overlay.append(element("line", { x1: a[0], y1: a[1], x2: b[0], y2: b[1] }));
  for (const p of [a, b]) overlay.append(element("line", { x1: p[0] - (b[1] - a[1]) * 0.03, y1: p[1] + (b[0] - a[0]) * 0.03, x2: p[0] + (b[1] - a[1]) * 0.03, y2: p[1] - (b[0] - a[0]) * 0.03 }));
  markStart(a);
  if (!heights) overlay.append(element("text", { x: (a[0] + b[0]) / 2, y: (a[1] + b[1]) / 2 - 8 }, lengthText(...ruler)));
}

// <profile.js>

// <notes.js>

// ---------------------------------------------------------------- controls

const current = () => state.lamps[state.lamp];

function button(label, pressed, press, title) {
  const made = document.createElement("button");
  made.type = "button";
  made.textContent = label;
  if (pressed !== null) made.setAttribute("aria-pressed", String(pressed));
  if (title) made.title = title;
  made.addEventListener("click", press);
  return made;
}

function options(select, labels) {
  select.replaceChildren(...labels.map((label, k) => { const one = document.createElement("option"); one.value = String(k); one.textContent = label; return one; }));
}

function refresh() {
  const handles = byId("hv-handles"), lamp = current();
  handles.replaceChildren(...state.lamps.map((one, k) => element("circle", { cx: 100 * one.x, cy: -100 * one.y, r: 9, class: k === state.lamp ? "hv-handle hv-on" : "hv-handle" })));
  const d = direction(lamp), own = lamp.capture >= 0 ? data.lamps[lamp.capture] : null;
  const angle = (Math.acos(Math.min(d[2], 1)) * 180) / Math.PI, turn = (Math.atan2(lamp.x, lamp.y) * 180) / Math.PI;
  const text = `${angle.toFixed(0)}° from the camera, ${((turn + 360) % 360).toFixed(0)}° clockwise from the top`;
  byId("hv-direction").textContent = own ? `${own.name}: ${text}` : text;
  byId("hv-pad").setAttribute("aria-valuetext", text);
  byId("hv-strength").value = lamp.strength;
  byId("hv-spectrum").value = String(lamp.spectrum);
  byId("hv-lamps").replaceChildren(
    ...state.lamps.map((_, k) => button(`Lamp ${k + 1}`, k === state.lamp, () => { state.lamp = k; refresh(); })),
    ...(state.lamps.length < LAMPS ? [button("+", null, addLamp, "Add a lamp")] : []),
    ...(state.lamps.length > 1 ? [button("−", null, removeLamp, "Remove this lamp")] : []));
  byId("hv-views").replaceChildren(...VIEWS.map((one, k) => button(one.label, k === state.view, () => { state.view = k; changed(); })));
  byId("hv-zoom").textContent = `${Math.round((100 * state.scale) / data.pixel)} %`;
  for (const one of document.querySelectorAll("[data-tool]")) if (one.tagName === "BUTTON") one.setAttribute("aria-pressed", String(one.dataset.tool === state.tool));
  frame.dataset.tool = state.tool;
  byId("hv-shadows").checked = state.shadows;
  byId("hv-photograph").value = String(state.photograph);
  byId("hv-exposure").value = state.stops;
  const view = VIEWS[state.view], legend = byId("hv-legend");
  legend.hidden = !view.range;
  if (view.range) { [byId("hv-low").textContent, byId("hv-unit").textContent, byId("hv-high").textContent] = [view.low, view.unit, view.high]; drawScale(); }
  for (const id of ["hv-left", "hv-right"]) byId(id).hidden = state.photograph < 0;
  status.textContent = view.note || data.note;
}

function drawScale() {
  const scale = byId("hv-scale"), context = scale.getContext("2d");
  const a = [[0.2777, 0.0054, 0.3341], [0.1051, 1.4046, 1.3846], [-0.3309, 0.2148, 0.0951], [-4.6342, -5.7991, -19.3324], [6.2283, 14.1799, 56.6906], [4.7764, -13.7451, -65.353], [-5.4355, 4.6459, 26.3124]];
  for (let x = 0; x < scale.width; x++) {
    const t = x / (scale.width - 1), stops = VIEWS[state.view].stops;
    const c = stops ? [0, 1, 2].map((k) => 255 * (t < 0.5 ? stops[0][k] + 2 * t * (stops[1][k] - stops[0][k]) : stops[1][k] + (2 * t - 1) * (stops[2][k] - stops[1][k]))) : [0, 1, 2].map((k) => 255 * Math.min(Math.max(a.reduceRight((sum, row) => sum * t + row[k], 0), 0), 1));
    context.fillStyle = `rgb(${c.map(Math.round).join(",")})`;
    context.fillRect(x, 0, 1, 1);
  }
}

function addLamp() {
  state.lamps.push({ ...lampAt(-current().x, current().y), strength: 0.6 });
  state.lamp = state.lamps.length - 1;
  changed();
}

function removeLamp() {
  state.lamps.splice(state.lamp, 1);
  state.lamp = Math.min(state.lamp, state.lamps.length - 1);
  changed();
}

function turnTo(tool) { state.tool = tool; refresh(); canvas.focus({ preventScroll: true }); }

function lampOfCapture(k) {
  const lamp = current(), d = data.lamps[k].toLamp;
  [lamp.x, lamp.y] = toPad(d);
  lamp.capture = k;
}

function compare(k) {
  const was = state.photograph;
  state.photograph = k;
  if (k >= 0) {
    const one = data.photographs[k];
    state.lamps = [lampAt(0, 0)];
    state.lamp = 0;
    lampOfCapture(one.lamp);
    state.stops = state.camera = 0;
    state.balance = true;
    byId("hv-camera").value = "0";
    byId("hv-balance").checked = true;
    if (!photographTextures[k]) {
      const image = new Image();
      image.onload = () => {
        const made = gl.createTexture();
        gl.bindTexture(gl.TEXTURE_2D, made);
        gl.pixelStorei(gl.UNPACK_COLORSPACE_CONVERSION_WEBGL, gl.NONE);
        gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, gl.RGBA, gl.UNSIGNED_BYTE, image);
        gl.generateMipmap(gl.TEXTURE_2D);
        gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR_MIPMAP_LINEAR);
        for (const key of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, key, gl.CLAMP_TO_EDGE);
        photographTextures[k] = made;
        ask();
      };
      image.src = `data:image/jpeg;base64,${byId(one.id).textContent}`;
    }
  }
  if ((was < 0) !== (k < 0) && state.fit) state.scale = 0;
  changed();
}

function connect() {
  options(byId("hv-spectrum"), data.colours.lamps);
  options(byId("hv-camera"), data.colours.cameras);
  byId("hv-spectrum-label").hidden = byId("hv-camera-label").hidden = byId("hv-balance-label").hidden = !data.colours.exact;
  byId("hv-shadows-label").hidden = !CASTS;
  byId("hv-view").hidden = !!data.stack;
  byId("hv-profile-tool").hidden = !data.scales.depth || !!data.stack;
  const assumed = byId("hv-assumptions");
  assumed.hidden = !(data.assumptions || []).length;
  assumed.querySelector("ul").append(...(data.assumptions || []).map((one) => { const made = document.createElement("li"); made.textContent = one; return made; }));
  byId("hv-compare-field").hidden = !data.photographs.length;
  options(byId("hv-photograph"), ["nothing", ...data.photographs.map((one) => one.name)]);
  [...byId("hv-photograph").options].forEach((one, k) => { one.value = String(k - 1); });
  byId("hv-dots").replaceChildren(...data.lamps.map((one) => { const [x, y] = toPad(one.toLamp); return element("circle", { cx: 100 * x, cy: -100 * y, r: 2.5, class: "hv-dot" }); }));
  const bind = (id, event, set) => byId(id).addEventListener(event, (happened) => { set(happened.target); changed(); });
  bind("hv-strength", "input", (one) => { current().strength = Number(one.value); });
  bind("hv-spectrum", "change", (one) => { current().spectrum = Number(one.value); });
  bind("hv-shadows", "change", (one) => { state.shadows = one.checked; });
  bind("hv-enhance", "input", (one) => { state.enhance = Number(one.value); });
  bind("hv-width", "input", (one) => { state.width = Number(one.value); });
  bind("hv-exposure", "input", (one) => { state.stops = Number(one.value); });
  bind("hv-camera", "change", (one) => { state.camera = Number(one.value); });
  bind("hv-balance", "change", (one) => { state.balance = one.checked; });
  byId("hv-photograph").addEventListener("change", (happened) => compare(Number(happened.target.value)));
  for (const one of document.querySelectorAll("button[data-tool]")) one.addEventListener("click", () => turnTo(one.dataset.tool));
  for (const one of document.querySelectorAll("[data-zoom]")) one.addEventListener("click", () => zoomTo(one.dataset.zoom));
  connectPad();
  connectCanvas();
  connectNotes();
  document.addEventListener("keydown", key);
  document.addEventListener("keyup", (happened) => { if (happened.key === " ") space = false; });
  new ResizeObserver(() => { ask(); plotHeights(); }).observe(frame);
}

function zoomTo(what) {
  if (!state.scale) fit();  // not drawn since the panes changed
  const pane = panes()[panes().length - 1], x = pane.x + pane.width / 2, y = pane.y + pane.height / 2;
  if (what === "fit") { fit(); ask(); } else if (what === "one") zoom(data.pixel / state.scale, x, y);
  else zoom(what === "in" ? 1.25 : 0.8, x, y);
}

function connectPad() {
  const pad = byId("hv-pad");
  const move = (happened) => {
    const box = pad.getBoundingClientRect(), scale = 104 / 100;
    const x = ((happened.clientX - box.left) / box.width * 2 - 1) * scale, y = (1 - (happened.clientY - box.top) / box.height * 2) * scale;
    place(current(), x, y);
  };
  pad.addEventListener("pointerdown", (happened) => {
    pad.setPointerCapture(happened.pointerId);
    const box = pad.getBoundingClientRect(), px = ((happened.clientX - box.left) / box.width * 2 - 1) * 1.04, py = (1 - (happened.clientY - box.top) / box.height * 2) * 1.04;
    state.lamps.forEach((one, k) => { if (Math.hypot(one.x - px, one.y - py) < 0.14) state.lamp = k; });
    move(happened);
  });
  pad.addEventListener("pointermove", (happened) => { if (pad.hasPointerCapture(happened.pointerId)) move(happened); });
}

let space = false;

function connectCanvas() {
  const pointers = new Map();
  let action = null, spread = 0, last = null, start = null;  // start: place, lamp and ruler when the first finger came
  const at = (happened) => { const box = canvas.getBoundingClientRect(), ratio = canvas.width / box.width; return [(happened.clientX - box.left) * ratio, (happened.clientY - box.top) * ratio]; };
  const middle = () => { const all = [...pointers.values()]; return [0, 1].map((k) => all.reduce((sum, one) => sum + one[k], 0) / all.length); };
  const apart = () => { const [a, b] = [...pointers.values()]; return b ? Math.hypot(a[0] - b[0], a[1] - b[1]) : 0; };
  const lamp = (p) => {
    const pane = paneAt(...p), half = Math.min(pane.width, pane.height) / 2;
    place(current(), (p[0] - pane.x - pane.width / 2) / half, -(p[1] - pane.y - pane.height / 2) / half);
  };
  const takeBack = () => {  // two fingers rarely touch at once: the first one was not to move the lamp
    if (action === "light") Object.assign(current(), start.lamp);
    if (action === "ruler" || action === "profile") { ruler = start.ruler; follow(start.heights); }
    changed();
  };
  canvas.addEventListener("contextmenu", (happened) => happened.preventDefault());
  canvas.addEventListener("pointerdown", (happened) => {
    canvas.setPointerCapture(happened.pointerId);
    canvas.focus({ preventScroll: true });
    const p = at(happened);
    pointers.set(happened.pointerId, p);
    if (pointers.size === 2 && start && Math.hypot(last[0] - start.p[0], last[1] - start.p[1]) < 12 * (window.devicePixelRatio || 1)) takeBack();
    if (pointers.size === 1) start = { p, lamp: { ...current() }, ruler, heights: !!heights };
    action = pointers.size > 1 ? "pinch" : happened.button > 0 || space ? "move" : state.tool;
    spread = apart();
    last = middle();
    if (action === "light") lamp(p);
    stroke = null;
    if (action === "note") { happened.preventDefault(); stroke = [toPage(...p)]; }
    if (action === "ruler" || action === "profile") { const start = toPage(...p); ruler = [start, start]; follow(action === "profile"); ask(); }
  });
  canvas.addEventListener("pointermove", (happened) => {
    if (!pointers.has(happened.pointerId)) return;
    const p = at(happened);
    pointers.set(happened.pointerId, p);
    if (action === "note") { if (stroke) addStroke(toPage(...p)); return; }
    if (action === "light" || action === "ruler" || action === "profile") last = p;
    if (action === "light") lamp(p);
    else if (action === "ruler" || action === "profile") { ruler = [ruler[0], toPage(...p)]; follow(action === "profile"); ask(); }
    else {
      const m = middle();
      state.x -= (m[0] - last[0]) / state.scale;
      state.y -= (m[1] - last[1]) / state.scale;
      state.fit = false;
      last = m;
      if (pointers.size > 1) {
        const now = apart();
        if (spread > 0) zoom(now / spread, ...m);
        spread = now;
      }
      ask();
    }
  });
  for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, (happened) => {
    pointers.delete(happened.pointerId);
    if (end === "pointerup" && action === "note") endStroke();
    stroke = null;
    if (!pointers.size) action = null; else last = middle();
  });
  canvas.addEventListener("wheel", (happened) => { happened.preventDefault(); zoom(Math.exp(-happened.deltaY * (happened.deltaMode ? 0.05 : 0.0015)), ...at(happened)); }, { passive: false });
}

function key(happened) {
  if (/^(INPUT|SELECT|TEXTAREA)$/.test(happened.target.tagName) || happened.ctrlKey || happened.metaKey || happened.altKey) return;
  const inside = byId("hv").contains(happened.target) || happened.target === document.body;
  if (!inside) return;
  const arrows = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[happened.key];
  const focused = happened.target === canvas || happened.target === byId("hv-pad") || data.alone;
  if (arrows && focused) {
    const by = (happened.shiftKey ? 5 : 1) * STEP / (Math.PI / 2);
    place(current(), current().x + by * arrows[0], current().y + by * arrows[1]);
    happened.preventDefault();
    return;
  }
  const acts = {
    "+": () => zoomTo("in"), "=": () => zoomTo("in"), "-": () => zoomTo("out"), 0: () => zoomTo("fit"), 1: () => zoomTo("one"),
    l: () => turnTo("light"), m: () => turnTo("move"), r: () => turnTo("ruler"), h: () => { if (data.scales.depth && !data.stack) turnTo("profile"); },
    n: () => turnTo("note"),
    v: () => { state.view = (state.view + 1) % VIEWS.length; changed(); },
    s: () => { state.shadows = !state.shadows && CASTS; changed(); },
    p: () => { if (data.photographs.length) compare(((state.photograph + 2) % (data.photographs.length + 1)) - 1); },
    "[": () => { state.stops = Math.max(state.stops - 0.25, -3); changed(); },
    "]": () => { state.stops = Math.min(state.stops + 0.25, 3); changed(); },
  }[happened.key.length === 1 ? happened.key.toLowerCase() : happened.key];
  if (happened.key === " " && happened.target === canvas) { space = true; happened.preventDefault(); }
  if (acts && (focused || data.alone)) acts();
}

// ---------------------------------------------------------------- start

function pixels() {  // the lit picture of the first level, RGBA by rows, as it is shown at 1:1
  const one = tiles.get("0-0-0");
  updateMaterials();
  updateShadows();
  one.shade();
  into(one.target, one.width, one.height);
  const read = new Uint8Array(4 * one.width * one.height);
  gl.readPixels(0, 0, one.width, one.height, gl.RGBA, gl.UNSIGNED_BYTE, read);
  return { width: one.width, height: one.height, data: read };
}

function framesPerSecond(count) {  // of a lamp that moves, everything drawn
  const one = new Uint8Array(4), begun = performance.now();
  for (let k = 0; k < count; k++) {
    place(current(), 0.5 * Math.cos(k), 0.5 * Math.sin(k));
    draw();
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, one);
  }
  return (1000 * count) / (performance.now() - begun);
}

async function start() {
  if (!gl) throw new Error("This page needs WebGL2, which this browser does not offer.");
  if (!("DecompressionStream" in window)) throw new Error("This page needs a browser from 2023 or later (DecompressionStream).");
  prepare();
  shadowTarget = target(1, 1, false);
  const arrived = [];
  await readErrors();
  window.hagoromoTile = (key, header, text) => arrived.push(addTile(key, header, text));
  connect();
  refresh();
  if (data.folder) { want(`${data.levels.length - 1}-0-0`); }
  else await Promise.all(data.tiles.map((one) => addTile(one.key, one.header, byId(`hv-tile-${one.key}`).textContent)));
  message.hidden = true;
  draw();
}

const ready = start().catch((error) => { message.hidden = false; message.textContent = error.message; throw error; });
canvas.addEventListener("webglcontextlost", () => { message.hidden = false; message.textContent = "The graphics processor was reset: load the page again."; });
const compared = () => state.photograph in photographTextures;  // whether the photograph has been decoded
const picture = () => { draw(); return canvas.toDataURL(); };  // all that the page shows now, as a PNG
window.hagoromo = { ready, state, pixels, picture, compared, length: lengthText, notes: () => JSON.parse(notesFile()), takeNotes, profile: (a, b) => { ruler = [a, b]; follow(true); ask(); return heights; }, framesPerSecond, redraw: changed, tiles: () => tiles.size, light: () => state.lamps.map(light) };
